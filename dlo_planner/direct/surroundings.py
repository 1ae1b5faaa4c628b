# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What surrounds a DLO: gravity, further loads, obstacles."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, items, returned, vector
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Sheet
from dlo_planner.model.rod import Rod, loads_of_length
from dlo_planner.model.supports import PointLoad
from dlo_planner.model.value import Value, put
from dlo_planner.model.varying import Profile, breaks_of, resolved

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
GRIPPERS = ('clamped', 'pinned')


@dataclass(frozen=True, eq=False, repr=False)
class Surroundings(Value):
    """A Rod and all that acts on it but its grippers; raises InvalidTask as `DirectSimulator`."""

    rod: Rod
    gravity: Floats  # (3,) m/s^2
    load: Floats | Callable[[float], ArrayLike] | None = None  # N/m, besides the weight
    obstacles: tuple[Obstacle, ...] = ()
    point_loads: tuple[PointLoad, ...] = ()
    grip: str = 'clamped'  # one of GRIPPERS: how the gripper holds the DLO's beginning

    def __post_init__(self) -> None:
        instance('rod', self.rod, Rod)
        choice('grip', self.grip, GRIPPERS)
        put(self, gravity=vector('gravity', self.gravity, 3),
            obstacles=items('obstacles', self.obstacles, OBSTACLES),
            point_loads=items('point_loads', self.point_loads, PointLoad))
        for one in self.point_loads:
            if one.s is not None and one.s > self.rod.length:
                raise InvalidTask(f'PointLoad.s = {one.s:g}: expected a place on the DLO, at most '
                                  f'{self.rod.length:g} m')
        if self.pinned and self.rod.yields:
            raise InvalidTask('grip = \'pinned\': expected \'clamped\' where the rod yields')
        if self.pinned and any(one.moment.any() for one in self.point_loads):
            raise InvalidTask('grip = \'pinned\': expected \'clamped\' where dead moments act')
        if self.load is not None and not callable(self.load):
            put(self, load=vector('load', self.load, 3))
        if self.rod.radius is None and any(isinstance(one, Sheet) for one in self.obstacles):
            raise InvalidTask('Rod.radius = None: expected the DLO\'s radius where a Sheet is an '
                              'obstacle')
        super().__post_init__()

    def of_rod(self, rod: Rod) -> Self:
        """Return the same about another Rod (as long or not).

        PointLoads in the last twentieth of this one that would be beyond the other's end, or are at
        this one's, are at the other's.
        """
        instance('rod', rod, Rod)
        return replace(self, rod=rod,
                       point_loads=loads_of_length(self.point_loads, self.rod, rod.length))

    @cached_property
    def load_profile(self) -> Profile:
        """Profile of a load that varies along the DLO."""
        load: Any = self.load
        return resolved('load', lambda s: vector(f'load({s:g})', returned('load', load, s), 3),
                        self.rod.length, breaks_of(load), InvalidTask)

    @cached_property
    def breaks(self) -> Floats:
        """(n,) arc lengths inside the DLO at which what acts on it, or it itself, jumps, m."""
        places = [one.s for one in self.point_loads
                  if one.s is not None and 0 < one.s < self.rod.length]
        if callable(self.load):
            places.extend(self.load_profile.breaks)
        return np.union1d(self.rod.breaks, places)

    @cached_property
    def has_moments(self) -> bool:
        """Whether a dead moment acts somewhere."""
        return any(one.moment.any() for one in self.point_loads)

    @cached_property
    def free(self) -> Self:
        """The same without what acts only where it is touched or reached: obstacles, yielding."""
        rod = self.rod
        if rod.yields:
            rod = replace(rod, yield_curvature=None, yield_torsion=None)
        return replace(self, rod=rod, obstacles=())

    @property
    def pinned(self) -> bool:
        """Whether the DLO's beginning may turn in the gripper."""
        return self.grip == 'pinned'


def judge_method(around: Surroundings, method: str, strains: str, basis: str) -> None:
    """Raise InvalidTask where the paper's methods and strains are asked for too much."""
    if strains == 'paper' and (method == 'newton' or basis == 'local'):
        raise InvalidTask(f'strains = {strains!r}: expected a series as basis and '
                          '\'dfp\' or \'downhill_simplex\' as method, got '
                          f'{basis!r}, {method!r}')
    if method == 'newton':
        return
    if around.obstacles:
        raise InvalidTask(f'method = {method!r}: expected \'newton\' with obstacles')
    if around.pinned:
        raise InvalidTask(f'method = {method!r}: expected \'newton\' with a pinned '
                          'gripper')
    if around.has_moments:
        raise InvalidTask(f'method = {method!r}: expected \'newton\' with dead moments')
