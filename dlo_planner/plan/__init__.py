# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans: gripper poses and the shapes of the DLO, and the demands on them."""
