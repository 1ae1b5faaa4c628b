"""A second grip: how the free end may be held."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.checks import choice, instance, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value

GRIPS = ('clamped', 'pinned', 'sleeve')


@dataclass(frozen=True, eq=False, repr=False)
class FarEnd(Value):
    """What holds the far end of a DLO.

    Attributes:
        pose: Pose where its frame has to be (x axis = tangent); where pinned only the position
            counts
        grip: 'clamped': position and orientation; 'pinned': position; 'sleeve': clamped, but free
            to slide along the pose's x axis
    """

    pose: Pose
    grip: str = 'clamped'

    def __post_init__(self):
        instance('FarEnd.pose', self.pose, Pose)
        choice('FarEnd.grip', self.grip, GRIPS)
        super().__post_init__()

    @classmethod
    def of(cls, value: 'FarEnd | Pose | ArrayLike | None') -> 'FarEnd | None':
        """Return a FarEnd from one, a Pose (clamped), a position (3,) (pinned), or None."""
        if value is None or isinstance(value, FarEnd):
            return value
        if isinstance(value, Pose):
            return cls(value)
        return cls(Pose(vector('far_end', value, 3), (0.0, 0.0, 0.0, 1.0)), 'pinned')

    @property
    def slide(self):
        """(3,) unit vector of the free direction, or zero."""
        return self.pose.direction if self.grip == 'sleeve' else np.zeros(3)
