# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A robot cell from its file: what a DLO may touch, and the holes it may be threaded through."""

from dlo_planner.scene.scene import Scene

__all__ = ['Scene']
