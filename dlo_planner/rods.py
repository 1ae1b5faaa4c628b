# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rods beyond a uniform one that is held at its end: sections, functions of s, a plug, a grasp."""

from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.model.rod import with_plug
from dlo_planner.model.section import Section
from dlo_planner.model.varying import Piecewise

__all__ = ['GraspedInside', 'Piecewise', 'Section', 'with_plug']
