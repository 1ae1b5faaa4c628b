# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rod of a scenario as a DLO in a gripper, and where it comes to rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cosserat.stretch import Stretch
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import PointLoad

_SAME = 1e-6      # of strain: what turns may still change
_TURNS = 40

Loads = Sequence[tuple[float, Floats]]  # unstretched arc length in m, force (3,) in N


@dataclass(frozen=True, eq=False)
class Cord:
    """A round, uniform, naturally straight rod with one end or both held.

    Attributes
    ----------
    length, radius : float
        Length and radius in m.
    density : float
        Density in kg/m^3.
    young, shear : float
        Young and shear in Pa.
    nodes : ndarray, shape (n + 1, 3)
        Where it begins, directors: (n, 3) of its elements.
    grip : str
        'clamped' or 'pinned', of its first end.
    far_grip : str or None
        Far grip of its last end, or None.
    pull : ndarray, shape (3,)
        Pull in N, on its last end.
    gravity : ndarray, shape (3,)
        Gravity in m/s^2.
    """

    length: float
    radius: float
    density: float
    young: float
    shear: float
    nodes: Floats
    directors: Floats
    grip: str
    far_grip: str | None
    pull: Floats
    gravity: Floats

    @property
    def area(self) -> float:
        """m^2."""
        return np.pi * self.radius**2

    @property
    def n(self) -> int:
        """Number of elements."""
        return len(self.directors)

    @property
    def gripper(self) -> Pose:
        """Where it is held: x axis = its first element, y axis = that one's director."""
        return _frame(self.nodes[0], self.nodes[1] - self.nodes[0], self.directors[0])

    @property
    def far_end(self) -> FarEnd | None:
        """What holds its last end."""
        if self.far_grip is None:
            return None
        return FarEnd(_frame(self.nodes[-1], self.nodes[-1] - self.nodes[-2], self.directors[-1]),
                      self.far_grip)

    def rod(self, stretch: Stretch, **more: Any) -> Rod:
        """Return the Rod of the cord, stretched."""
        area, inertia = self.area, np.pi * self.radius**4 / 4
        return Rod(stretch.length, stretch.times(self.density * area, -1),
                   stretch.times(self.young * inertia, 1),
                   stretch.times(2 * self.shear * inertia, 1), radius=self.radius, **more)

    def simulator(self, rod: Rod, stretch: Stretch, loads: Loads = ()) -> DirectSimulator:
        """Return the DirectSimulator of the cord, stretched.

        Parameters
        ----------
        rod : Rod
            What `rod` returned for `stretch`.
        loads : Loads, optional
            (unstretched arc length in m, force (3,) in N) each.
        """
        points = [PointLoad(force, s=float(stretch.to_stretched(s))) for s, force in loads]
        if self.pull.any():
            points.append(PointLoad(self.pull))
        nodes = {*stretch.free, *(s for s, _ in loads)}
        return DirectSimulator(rod, basis='local',
                               n_elements=max(self.n, len(nodes) - 1),
                               gravity=self.gravity, point_loads=points, grip=self.grip)

    def strains(self, shape: Shape, stretch: Stretch, loads: Loads = ()) -> Stretch:
        """Return how far the tension in a shape stretches the cord.

        An element with the force F beyond it is in equilibrium where E A e = F . chord / length.
        """
        free = stretch.to_free(shape.s)
        middle = 0.5 * (free[1:] + free[:-1])
        beyond = (self.pull + (shape.far_wrench[:3] if self.far_grip else 0.0)
                  + (self.density * self.area * (self.length - middle))[:, None] * self.gravity)
        for s, force in loads:
            beyond = beyond + (s > middle)[:, None] * force
        chord = np.diff(shape.positions, axis=0) / np.diff(shape.s)[:, None]
        own = Stretch.along(free, np.einsum('ki,ki->k', beyond, chord) / (self.young * self.area))
        even = np.linspace(0, self.length, self.n + 1)  # without nodes at loads, which move
        return Stretch.along(even, np.diff(own.to_stretched(even)) / np.diff(even) - 1)


def at_rest(cord: Cord, rod: Rod, stretch: Stretch, loads: Loads = ()) -> Shape:
    """Return the Shape in which a cord comes to rest whose Stretch is given.

    Raises
    ------
    FloatingPointError
        None was found.
    """
    simulator = cord.simulator(rod, stretch, loads)
    shape = simulator.solve(cord.gripper, far_end=cord.far_end)
    if not shape.converged:
        raise FloatingPointError(f'no equilibrium was found: {shape.status}')
    return shape


def settled(cord: Cord) -> tuple[Shape, Stretch]:
    """Return the Shape in which a cord comes to rest, and its Stretch.

    Raises
    ------
    FloatingPointError
        None was found.
    """
    stretch = Stretch.none(cord.length)
    for _ in range(_TURNS):
        shape = at_rest(cord, cord.rod(stretch), stretch)
        after = cord.strains(shape, stretch)
        change = after.change(stretch)
        if change < _SAME:
            return shape, stretch
        stretch = after
    raise FloatingPointError(f'strains still change by {change:.1e}')


def recorded(cord: Cord, shape: Shape, stretch: Stretch) -> tuple[Floats, Floats]:
    """Return positions (n + 1, 3) of even nodes, and directors (n, 3) of the elements between."""
    even = np.linspace(0, cord.length, cord.n + 1)
    ends = np.minimum(stretch.to_stretched(even), shape.s[-1])
    middles = np.minimum(stretch.to_stretched(0.5 * (even[1:] + even[:-1])), shape.s[-1])
    positions = shape.positions_at(ends)
    directors = np.array([shape.frame_at(float(s))[0][:, 1] for s in middles])
    tangents = np.diff(positions, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    directors -= np.einsum('ki,ki->k', directors, tangents)[:, None] * tangents
    return positions, directors / np.linalg.norm(directors, axis=1)[:, None]


def _frame(position: Floats, along: Floats, beside: Floats) -> Pose:
    t = along / np.linalg.norm(along)
    n = beside - (beside @ t) * t
    n /= np.linalg.norm(n)
    return Pose.from_rotation(position, np.column_stack([t, n, np.cross(t, n)]))
