"""Direct and inverse simulation of deformable linear objects in a gripper; no ROS in here."""

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import (
    DloPlannerError,
    Infeasible,
    InvalidRod,
    InvalidTask,
    NotConverged,
)
from dlo_planner.inverse.plan import Plan, PlanStatus
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod

__all__ = ['CutOut', 'DirectSimulator', 'DloPlannerError', 'Infeasible', 'InvalidRod',
           'InvalidTask', 'InverseSimulator', 'Motion', 'NotConverged', 'Plan', 'PlanStatus',
           'Pose', 'Rod', 'Shape']
