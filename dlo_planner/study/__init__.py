# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's own methods, for study. Nothing imports this room; `extras.studied` finds it by name.

Davidon-Fletcher-Powell and the downhill simplex (`minimizers`), series of the paper's strains
(`strains`), nested optimization of a waypoint (`nested`), steps computed ahead (`speculation`).
"""
