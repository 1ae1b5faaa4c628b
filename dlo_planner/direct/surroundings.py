"""What surrounds a DLO: gravity, further loads, obstacles."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import choice, instance, items, vector
from dlo_planner.model.obstacles import OBSTACLES, Sheet
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, put

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
GRIPPERS = ('clamped', 'pinned')


@dataclass(frozen=True, eq=False, repr=False)
class Surroundings(Value):
    """A Rod and all that acts on it but its grippers.

    Attributes:
        rod: Rod
        gravity: (3,) m/s^2
        load: force per length besides the weight, N/m, world axes: (3,), a callable of s, or None
        obstacles: tuple of Plane, Sphere, Capsule, Box, Sheet
        grip: of GRIPPERS, how the gripper holds the DLO's beginning

    Raises:
        InvalidTask: naming the argument
    """

    rod: Rod
    gravity: np.ndarray
    load: np.ndarray | Callable | None = None
    obstacles: tuple = ()
    grip: str = 'clamped'

    def __post_init__(self):
        instance('rod', self.rod, Rod)
        choice('grip', self.grip, GRIPPERS)
        put(self, gravity=vector('gravity', self.gravity, 3),
            obstacles=items('obstacles', self.obstacles, OBSTACLES))
        if self.load is not None and not callable(self.load):
            put(self, load=vector('load', self.load, 3))
        if self.rod.radius is None and any(isinstance(one, Sheet) for one in self.obstacles):
            raise InvalidTask('Rod.radius = None: expected the DLO\'s radius where a Sheet is an '
                              'obstacle')
        super().__post_init__()

    @property
    def pinned(self):
        """Whether the DLO's beginning may turn in the gripper."""
        return self.grip == 'pinned'
