"""What surrounds a DLO: gravity, further loads, obstacles."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import vector
from dlo_planner.model.obstacles import OBSTACLES, Sheet
from dlo_planner.model.rod import Rod

STANDARD_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A Rod and all that acts on it but its grippers.

    Attributes:
        rod: Rod
        gravity: (3,) m/s^2
        load: force per length besides the weight, N/m, world axes: (3,), a callable of s, or None
        obstacles: tuple of Plane, Sphere, Capsule, Box, Sheet

    Raises:
        InvalidTask: naming the argument
    """

    rod: Rod
    gravity: np.ndarray
    load: np.ndarray | Callable | None = None
    obstacles: tuple = ()

    def __post_init__(self):
        if not isinstance(self.rod, Rod):
            raise InvalidTask(f'rod = {self.rod!r}: expected a Rod')
        object.__setattr__(self, 'gravity', vector('gravity', self.gravity, 3))
        if self.load is not None and not callable(self.load):
            object.__setattr__(self, 'load', vector('load', self.load, 3))
        try:
            obstacles = tuple(self.obstacles)
        except TypeError:
            raise InvalidTask(f'obstacles = {self.obstacles!r}: expected a sequence') from None
        for index, obstacle in enumerate(obstacles):
            if not isinstance(obstacle, OBSTACLES):
                names = ', '.join(kind.__name__ for kind in OBSTACLES)
                raise InvalidTask(f'obstacles[{index}] = {obstacle!r}: expected one of {names}')
            if isinstance(obstacle, Sheet) and self.rod.radius is None:
                raise InvalidTask('Rod.radius = None: expected the DLO\'s radius where a Sheet is '
                                  'an obstacle')
        object.__setattr__(self, 'obstacles', obstacles)
