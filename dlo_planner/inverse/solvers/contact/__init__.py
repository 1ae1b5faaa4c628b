# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Solvers for a DLO that touches an obstacle at a given place and in a given direction."""
