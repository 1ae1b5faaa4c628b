# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion at one instant."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from dlo_planner.direct.culling import remembers_nothing
from dlo_planner.direct.integrator import KinematicState
from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats


@dataclass(frozen=True)
class Instant:
    """All that the rest of a motion depends on, and what has become of the energy.

    Attributes
    ----------
    place : float
        Time / dt.
    shape : Shape
    nodes : KinematicState
        Their (N + 1, 3) positions.
    bends : KinematicState
        The (N, 3) strains of the elements.
    kinetic : float
        Kinetic energy, J.
    potential : float
        Potential energy, J.
    work : float
        Work done by the grips so far, J.
    power : float
        Power of the grips now, W.
    losses : ndarray, shape (3,)
        Energy lost to damping, plasticity and friction so far, J.
    touched : bool
        Whether the DLO has touched an obstacle.
    pushed : float
        Work that contacts have done so far because a step follows a chord where the DLO slides
        along a curve, J: of first order, and none in truth.
    """

    place: float
    shape: Shape
    nodes: KinematicState
    bends: KinematicState
    kinetic: float
    potential: float
    work: float
    power: float
    losses: Floats
    touched: bool = False
    pushed: float = 0.0

    def __getattr__(self, name: str) -> Any:
        """Make a shape, nodes or bends that a motion may never be asked for."""
        if name not in _BOXED or 'boxed' not in self.__dict__:
            raise AttributeError(name)
        made = self.__dict__[name] = self.__dict__['boxed'](name)
        return made

    @property
    def free(self) -> bool:
        """Whether nothing has acted on the DLO but what acts on all of them."""
        if self.touched:
            return False
        # one whose Shape is not made yet is of `leg.swung`
        return 'shape' not in self.__dict__ or remembers_nothing(self.shape)

    @property
    def positions(self) -> Floats:
        """(N + 1, 3) of the nodes, m."""
        return self._of_nodes('positions', 'position')

    @property
    def velocities(self) -> Floats:
        """(N + 1, 3) of the nodes, m/s."""
        return self._of_nodes('velocities', 'velocity')

    def _of_nodes(self, several: str, one: str) -> Floats:
        """Return what `nodes` has under the name `one`; it is not made for that alone."""
        known = self.__dict__.get('nodes')
        result: Floats = (self.__dict__['boxed'](several) if known is None
                          else getattr(known, one))
        return result

    @classmethod
    def made(cls, **contents: Any) -> 'Instant':
        """Return the Instant with these fields: quicker than by its constructor.

        Parameters
        ----------
        contents : object
            All fields, but for those in _BOXED which `boxed`, a function of their name, makes; and
            also 'positions' and 'velocities'.
        """
        instant = object.__new__(cls)
        instant.__dict__.update(contents)
        return instant

    def changed(self, **contents: Any) -> 'Instant':
        """Return the same Instant with other values of some fields."""
        return self.made(**(self.__dict__ | contents))

    @property
    def balance(self) -> float:
        """Energy that is there, less what was put in, plus what was taken out, J."""
        given = self.work + self.pushed
        return self.kinetic + self.potential - given + float(self.losses.sum())


_BOXED = ('shape', 'nodes', 'bends')


class There(NamedTuple):
    """What was found a very short time later.

    Attributes
    ----------
    positions, strains : ndarray, shape (N + 1, 3), (N, 3)
        Of the nodes, world, m; of the elements, 1/m.
    wrench, far_wrench : ndarray, shape (6,)
        Of the gripper and of the far end on the DLO.
    """

    positions: Floats
    strains: Floats
    wrench: Floats
    far_wrench: Floats
