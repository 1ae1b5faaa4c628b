# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Core objects of `dlo_planner` to ROS messages and back; nothing else."""
