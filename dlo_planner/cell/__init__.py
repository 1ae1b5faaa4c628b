# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cell to try plans in: a DLO in a physics engine that shares no code with the planner."""
