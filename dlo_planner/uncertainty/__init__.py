# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is not known of a DLO, its gripper and a camera, and how shapes move with it."""
