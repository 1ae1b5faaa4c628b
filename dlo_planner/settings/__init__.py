# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: one table, read from YAML, and what their values describe; no ROS in here."""
