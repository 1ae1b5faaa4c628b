# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The names of the package itself; `import dlo_planner` loads them when one is asked for.

The rest is in `dlo_planner.tasks`, `.penalties`, `.rods`, `.scene`, `.results`, `.identify`,
`.closed_loop`, `.parallel`, `.arm` and `.view`.
"""

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import (
    DeadlineExceeded,
    DloPlannerError,
    DoubtfulInput,
    Infeasible,
    InvalidRod,
    InvalidTask,
    NotConverged,
)
from dlo_planner.identify.closed_loop import ClosedLoop
from dlo_planner.identify.fit import fit_rod
from dlo_planner.identify.observer import Observer
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.tasks.contact import HoldContact, SlideContact
from dlo_planner.inverse.tasks.insert import Insert
from dlo_planner.inverse.tasks.lay_on_line import LayOnLine
from dlo_planner.inverse.tasks.minimize import Minimize
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.inverse.tasks.thread_sequence import ThreadSequence
from dlo_planner.inverse.tasks.thread_two import ThreadTwo
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import FarEnd, Hold
from dlo_planner.model.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Hull,
    Mesh,
    Plane,
    Sheet,
    Sphere,
)
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import PointLoad
from dlo_planner.parallel.batch import solve_many
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.uncertainty.parameters import Uncertainty
from dlo_planner.verify.replay import replay
from dlo_planner.verify.robustness import robustness

__all__ = ['Box', 'Capsule', 'ClosedLoop', 'CutOut', 'Cylinder', 'DeadlineExceeded',
           'DirectSimulator', 'DloPlannerError', 'DoubtfulInput', 'Ellipsoid', 'FarEnd',
           'Hold', 'HoldContact', 'Hull', 'Infeasible', 'Insert', 'InvalidRod', 'InvalidTask',
           'InverseSimulator', 'LayOnLine', 'Limits', 'Mesh', 'Minimize', 'NotConverged',
           'Observer', 'Plan', 'Plane', 'PointLoad', 'Pose', 'Rod', 'Shape', 'Sheet',
           'SlideContact', 'Sphere', 'Thread', 'ThreadSequence', 'ThreadTwo', 'Trajectory',
           'Uncertainty', 'Workspace', 'fit_rod', 'replay', 'robustness', 'solve_many']
