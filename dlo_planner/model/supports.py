# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What surrounds a DLO: loads, obstacles, gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, flag, instance, items, number, returned, vector
from dlo_planner.model.holds import FarEnd  # noqa: F401  (where pickles of old look for it)
from dlo_planner.model.obstacles import OBSTACLES, Mesh, Obstacle, Sheet
from dlo_planner.model.rod import Rod, Surface, part_of_rod
from dlo_planner.model.value import Value, put
from dlo_planner.model.varying import Mapped, Profile, breaks_of, resolved

# ------------------------------------------------------------------------------------------------
# A dead load at one point of a DLO.


@dataclass(frozen=True, eq=False, repr=False)
class PointLoad(Value):
    """A force and a moment of constant size and direction at a point of the DLO.

    Attributes
    ----------
    force : ndarray, shape (3,)
        Force in N, world axes.
    moment : ndarray, shape (3,)
        Moment in N m, world axes.
    s : float or None
        Arc length of the point, m. If None, the tip.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    force: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # an array from then on
    moment: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    s: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, force: ArrayLike = (0.0, 0.0, 0.0), moment: ArrayLike = (0.0, 0.0, 0.0),
                     s: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, force=vector('PointLoad.force', self.force, 3),
            moment=vector('PointLoad.moment', self.moment, 3))
        if self.s is not None:
            put(self, s=number('PointLoad.s', self.s, minimum=0))
        super().__post_init__()


# What `point_loads` may hold. Of any other kind than PointLoad the term of the potential makes what
# it needs (`made`, see `energy.terms`): it is no dead load. One that acts at a place of the DLO has
# a field `s`, as a PointLoad has; meshes have a node there.
AnyLoad: TypeAlias = PointLoad
LOADS: tuple[type, ...] = get_args(AnyLoad) or (AnyLoad,)


# ------------------------------------------------------------------------------------------------
# All that acts on a DLO but its grippers.


STANDARD_GRAVITY = (0.0, 0.0, -9.81)
GRIPPERS = ('clamped', 'pinned')
_NEAR = 0.05  # of the length: a load so near to the end is one at the end


@dataclass(frozen=True, eq=False, repr=False)
class Surroundings(Value):
    """A Rod and all that acts on it but its grippers; raises InvalidTask as `DirectSimulator`."""

    rod: Rod
    gravity: Floats  # (3,) m/s^2
    load: Floats | Callable[[float], ArrayLike] | None = None  # N/m, besides the weight
    obstacles: tuple[Obstacle, ...] = ()
    point_loads: tuple[AnyLoad, ...] = ()
    grip: str = 'clamped'  # one of GRIPPERS: how the gripper holds the DLO's beginning
    self_contact: bool = False  # whether strands of the DLO keep each other off
    self_friction: float = 0.0  # coefficient of friction between strands

    def __post_init__(self) -> None:
        instance('rod', self.rod, Rod)
        choice('grip', self.grip, GRIPPERS)
        put(self, gravity=vector('gravity', self.gravity, 3),
            obstacles=items('obstacles', self.obstacles, OBSTACLES),
            point_loads=items('point_loads', self.point_loads, LOADS))
        for one in self.point_loads:
            s = _place(one)
            if s is not None and s > self.rod.length:
                raise InvalidTask(f'{type(one).__name__}.s = {s:g}: expected a place on the DLO, '
                                  f'at most {self.rod.length:g} m')
        if self.pinned and self.rod.yields:
            raise InvalidTask('grip = \'pinned\': expected \'clamped\' where the rod yields')
        if self.pinned and self.has_moments:
            raise InvalidTask('grip = \'pinned\': expected \'clamped\' where dead moments act')
        if self.load is not None and not callable(self.load):
            put(self, load=vector('load', self.load, 3))
        flag('self_contact', self.self_contact)
        put(self, self_friction=number('self_friction', self.self_friction, minimum=0))
        if self.self_friction > 0.0 and not self.self_contact:
            raise InvalidTask(f'self_friction = {self.self_friction:g}: expected 0 without '
                              'self_contact')
        if self.self_contact:
            self._judge_self_contact()
        hollow = next((one for one in self.obstacles if isinstance(one, Sheet | Mesh)), None)
        if self.rod.radius is None and hollow is not None:
            raise InvalidTask('Rod.radius = None: expected the DLO\'s radius where a '
                              f'{type(hollow).__name__} is an obstacle')
        super().__post_init__()

    def _judge_self_contact(self) -> None:
        if self.rod.radius is None:
            raise InvalidTask('Rod.radius = None: expected the DLO\'s radius with self_contact')
        for given, what in ((self.pinned, "grip = 'pinned'"),
                            (self.rod.yields, 'a rod that yields'),
                            (Surface.of(self.rod).half is not None, 'a rectangular section'),
                            (self.has_moments, 'dead moments'),
                            (self.other_loads, 'point_loads that are no PointLoad')):
            if given:
                raise InvalidTask(f'self_contact = True: expected False with {what}, with '
                                  'which contact of the DLO with itself is not computed')

    def of_rod(self, rod: Rod) -> Self:
        """Return the same about another Rod (as long or not).

        Loads in the last twentieth of this one that would be beyond the other's end, or are at
        this one's, are at the other's.
        """
        instance('rod', rod, Rod)
        old, new = self.rod.length, rod.length
        end = max(min(old, new), (1 - _NEAR) * old)
        loads = [one if (s := _place(one)) is None or s < end else replace(one, s=new)
                 for one in self.point_loads]
        return replace(self, rod=rod, point_loads=tuple(loads))

    def part(self, at: float, direction: int) -> Self:
        """Return the same about the part from `at` (m) to one end: direction 1 to L, -1 to 0."""
        loads = []
        for one in self.point_loads:
            s = _place(one, self.rod.length)
            if s is None:
                loads.append(one)
            elif (s - at) * direction > 0 or s == at and direction > 0:
                loads.append(replace(one, s=abs(s - at)))
        load = self.load
        return replace(self, rod=part_of_rod(self.rod, at, direction),
                       load=Mapped(load, 1.0, at, direction) if callable(load) else load,
                       point_loads=tuple(loads))

    @property
    def dead_loads(self) -> tuple[PointLoad, ...]:
        """The PointLoads."""
        return tuple(one for one in self.point_loads if isinstance(one, PointLoad))

    @property
    def other_loads(self) -> tuple[Any, ...]:
        """The loads of other kinds."""
        return tuple(one for one in self.point_loads if not isinstance(one, PointLoad))

    @property
    def load_places(self) -> list[float]:
        """Arc lengths in m at which loads act that are not for the tip."""
        return [s for one in self.point_loads if (s := _place(one)) is not None]

    @cached_property
    def load_profile(self) -> Profile:
        """Profile of a load that varies along the DLO."""
        load: Any = self.load
        return resolved('load', lambda s: vector(f'load({s:g})', returned('load', load, s), 3),
                        self.rod.length, breaks_of(load), InvalidTask)

    @cached_property
    def breaks(self) -> Floats:
        """(n,) arc lengths inside the DLO at which what acts on it, or it itself, jumps, m."""
        places = [s for s in self.load_places if 0 < s < self.rod.length]
        if callable(self.load):
            places.extend(self.load_profile.breaks)
        return np.union1d(self.rod.breaks, places)

    @cached_property
    def has_moments(self) -> bool:
        """Whether a dead moment acts somewhere."""
        return any(one.moment.any() for one in self.dead_loads)

    @cached_property
    def free(self) -> Self:
        """The same without what acts only where it is touched or reached: obstacles, yielding."""
        rod = self.rod
        if rod.yields:
            rod = replace(rod, yield_curvature=None, yield_torsion=None)
        return replace(self, rod=rod, obstacles=())

    @cached_property
    def pinned(self) -> bool:
        """Whether the DLO's beginning may turn in the gripper."""
        return self.grip == 'pinned'


def _place(load: Any, tip: float | None = None) -> float | None:
    """Return the arc length of the place where a load acts, `tip` for the tip, None for none."""
    s: float | None = getattr(load, 's', None)
    return tip if s is None and hasattr(load, 's') else s
