# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The public names of the package; `import dlo_planner` loads them when one is asked for."""

from dlo_planner.direct.contacts import Contact
from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.direct.mode_tracking import modes_along
from dlo_planner.direct.modes import Modes
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
from dlo_planner.inverse.closed_loop import ClosedLoop, Phase
from dlo_planner.inverse.correction import Correction, correct
from dlo_planner.inverse.estimate import Estimate
from dlo_planner.inverse.fitting import Fit, fit_rod
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.observation import Observation, ObservedMotion
from dlo_planner.inverse.observer import Observer
from dlo_planner.inverse.penalties import (
    AwayFrom,
    BentAtMost,
    DirectionAt,
    GripperNear,
    PositionAt,
    Through,
)
from dlo_planner.inverse.plan import Plan, PlanStatus, joined
from dlo_planner.inverse.predicted_miss import PredictedMiss
from dlo_planner.inverse.replay import Report, replay
from dlo_planner.inverse.robustness import Robustness, Spread, robustness
from dlo_planner.inverse.search import Found, minimise_penalty
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.stamped import gripper_at
from dlo_planner.inverse.steering import Steered
from dlo_planner.inverse.trajectory import Trajectory
from dlo_planner.inverse.workspace import Workspace
from dlo_planner.model.along import Piecewise
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.obstacles import Box, Capsule, Plane, Sheet, Sphere
from dlo_planner.model.plug import with_plug
from dlo_planner.model.point_load import PointLoad
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.section import Section
from dlo_planner.parallel.mapping import solve_many
from dlo_planner.parallel.shapes import Shapes

__all__ = ['AwayFrom', 'BentAtMost', 'Box', 'Capsule', 'ClosedLoop', 'Contact', 'Correction',
           'CutOut', 'DeadlineExceeded', 'DirectSimulator', 'DirectionAt', 'DloPlannerError',
           'Estimate', 'FarEnd', 'Fit', 'Found', 'GraspedInside', 'GripperNear', 'Infeasible',
           'InvalidRod', 'InvalidTask', 'InverseSimulator', 'Limits', 'Modes', 'Motion',
           'NotConverged', 'Observation', 'ObservedMotion', 'Observer', 'Phase', 'Piecewise',
           'Plan', 'PlanStatus', 'Plane', 'PointLoad', 'Pose', 'PositionAt', 'PredictedMiss',
           'Report', 'Robustness', 'Rod', 'Section', 'Shape', 'Shapes', 'Sheet',
           'Sphere', 'Spread', 'Steered', 'Through', 'Trajectory', 'Workspace', 'correct',
           'fit_rod', 'gripper_at', 'joined', 'minimise_penalty', 'modes_along', 'replay',
           'robustness', 'solve_many', 'with_plug']
