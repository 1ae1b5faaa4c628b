# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The public names of the package; `import dlo_planner` loads them when one is asked for."""

from dlo_planner.direct.contact import Contact
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
from dlo_planner.identify.closed_loop import ClosedLoop, Phase
from dlo_planner.identify.correction import Correction, correct
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.fitting import Fit, fit_rod
from dlo_planner.identify.observation import Observation, ObservedMotion
from dlo_planner.identify.observer import Observer
from dlo_planner.identify.predicted_miss import PredictedMiss
from dlo_planner.identify.stamped import gripper_at
from dlo_planner.identify.steering import Steered
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.solvers.search import PenaltyResult, minimize_penalty
from dlo_planner.inverse.tasks import (
    Approach,
    HoldContact,
    Insert,
    Minimize,
    SlideContact,
    Thread,
    ThreadSequence,
    ThreadTwo,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Box, Capsule, Cylinder, Plane, Sheet, Sphere
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, with_plug
from dlo_planner.model.section import Section
from dlo_planner.model.supports import FarEnd, PointLoad
from dlo_planner.model.varying import Piecewise
from dlo_planner.parallel.mapping import solve_many
from dlo_planner.parallel.shapes import Shapes
from dlo_planner.plan.assembly import concatenate
from dlo_planner.plan.goals import (
    AwayFrom,
    BentAtMost,
    DirectionAt,
    FrameAt,
    GripperNear,
    KeepTangent,
    PositionAt,
    Through,
)
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.trajectory import Trajectory
from dlo_planner.plan.plan import Plan, PlanStatus
from dlo_planner.plan.requirements import Requirements
from dlo_planner.plan.workspace import Workspace
from dlo_planner.verify.replay import replay
from dlo_planner.verify.report import ValidationReport
from dlo_planner.verify.robustness import Robustness, robustness
from dlo_planner.verify.uncertainty import Uncertainty

__all__ = ['Approach', 'AwayFrom', 'BentAtMost', 'Box', 'Capsule', 'ClosedLoop', 'Contact',
           'Correction', 'CutOut', 'Cylinder', 'DeadlineExceeded', 'DirectSimulator',
           'DirectionAt', 'DloPlannerError', 'Estimate', 'FarEnd', 'Fit', 'FrameAt',
           'GraspedInside', 'GripperNear', 'HoldContact', 'Infeasible', 'Insert', 'InvalidRod',
           'InvalidTask', 'InverseSimulator', 'KeepTangent', 'Limits', 'Minimize', 'Modes',
           'Motion', 'NotConverged', 'Observation', 'ObservedMotion', 'Observer', 'PenaltyResult',
           'Phase', 'Piecewise', 'Plan', 'PlanStatus', 'Plane', 'PointLoad', 'Pose', 'PositionAt',
           'PredictedMiss', 'Requirements', 'Robustness', 'Rod', 'Section', 'Shape', 'Shapes',
           'Sheet', 'SlideContact', 'Sphere', 'Steered', 'Thread', 'ThreadSequence', 'ThreadTwo',
           'Through', 'Trajectory', 'Uncertainty', 'ValidationReport', 'Workspace', 'concatenate',
           'correct', 'fit_rod', 'gripper_at', 'minimize_penalty', 'modes_along', 'replay',
           'robustness', 'solve_many', 'with_plug']
