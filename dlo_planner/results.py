# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What simulations and proofs return: for annotations, and to load them from files."""

from dlo_planner.direct.modes import Modes
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.section_forces import SectionForces
from dlo_planner.direct.shape import Contact, SelfContact, Try, modes_along
from dlo_planner.direct.touches import Touch
from dlo_planner.parallel.shapes import Shapes
from dlo_planner.plan.stage import Metric, Stage
from dlo_planner.verify.report import ValidationReport
from dlo_planner.verify.robustness import Robustness

__all__ = ['Contact', 'Metric', 'Modes', 'Motion', 'Robustness', 'SectionForces', 'SelfContact',
           'Shapes', 'Stage', 'Touch', 'Try', 'ValidationReport', 'modes_along']
