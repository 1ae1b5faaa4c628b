# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Carrying out a plan: the motion, its guards, and the closed loop with a camera; no ROS."""
