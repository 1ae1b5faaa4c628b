# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The names of the package itself; `import dlo_planner` loads them when one is asked for.

The rest is in `dlo_planner.tasks`, `.penalties`, `.identify`, `.parallel`, `.arm` and `.view`.
"""

from dlo_planner.direct.contact import Contact
from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.direct.modes import Modes, modes_along
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import (
    DeadlineExceeded,
    DloPlannerError,
    Infeasible,
    InvalidRod,
    InvalidTask,
    NotConverged,
)
from dlo_planner.identify.closed_loop import ClosedLoop
from dlo_planner.identify.fit import fit_rod
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.observer import Observer
from dlo_planner.identify.parameters import Uncertainty
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.tasks import (
    HoldContact,
    Insert,
    Minimize,
    SlideContact,
    Thread,
    ThreadSequence,
    ThreadTwo,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Box, Capsule, Cylinder, Ellipsoid, Plane, Sheet, Sphere
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, with_plug
from dlo_planner.model.section import Section
from dlo_planner.model.supports import FarEnd, PointLoad
from dlo_planner.model.varying import Piecewise
from dlo_planner.parallel.batch import solve_many
from dlo_planner.parallel.shapes import Shapes
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.replay import replay
from dlo_planner.verify.report import ValidationReport
from dlo_planner.verify.robustness import Robustness, robustness

__all__ = ['Box', 'Capsule', 'ClosedLoop', 'Contact', 'CutOut', 'Cylinder', 'DeadlineExceeded',
           'DirectSimulator', 'DloPlannerError', 'Ellipsoid', 'FarEnd', 'GraspedInside',
           'HoldContact', 'Infeasible', 'Insert', 'InvalidRod', 'InvalidTask', 'InverseSimulator',
           'Limits', 'Minimize', 'Modes', 'Motion', 'NotConverged', 'Observation', 'Observer',
           'Piecewise', 'Plan', 'Plane', 'PointLoad', 'Pose', 'Robustness', 'Rod', 'Section',
           'Shape', 'Shapes', 'Sheet', 'SlideContact', 'Sphere', 'Thread', 'ThreadSequence',
           'ThreadTwo', 'Trajectory', 'Uncertainty', 'ValidationReport', 'Workspace', 'fit_rod',
           'modes_along', 'replay', 'robustness', 'solve_many', 'with_plug']
