# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a plan pushes a DLO into a bore: what is outside at each of its times."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization, with_breaks
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.loads import node_masses
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, before, part_of_rod
from dlo_planner.model.supports import PointLoad
from dlo_planner.plan.plan import Plan

_ELEMENTS, _FEWEST = 64, 24  # of the whole DLO, of what is left of it
_SAME = 1e-12      # of the length
_NO_ELEMENT = 0.02  # of an element: a shorter one at the mouth is none


@dataclass(frozen=True)
class Feed:
    """How a plan pushes a DLO into a bore.

    Attributes
    ----------
    simulator : DirectSimulator
        DirectSimulator of the whole DLO.
    mouth : Pose
        Pose, x axis into the bore.
    times : ndarray, shape (n,)
        Times of the plan, s.
    depths : ndarray, shape (n,)
        Depths in m.
    carried : ndarray, shape (n,)
        Part of the weight at the mouth that the mouth carries, N, against gravity.
    """

    simulator: DirectSimulator
    mouth: Pose
    times: Floats
    depths: Floats
    carried: Floats

    @classmethod
    def of(cls, simulator: DirectSimulator, plan: Plan) -> Feed:
        """Return that of a Plan in which a bore holds the DLO."""
        held = [shape.far_end is not None for shape in plan.shapes]
        mouth = next(shape.far_end.pose for shape in plan.shapes if shape.far_end is not None)
        up = _up(simulator.gravity)
        carried = np.array([shape.far_wrench[:3] @ up if inside else 0.0
                            for shape, inside in zip(plan.shapes, held, strict=True)])
        return cls(simulator.elastic().without_obstacles(), mouth, plan.times, plan.depths, carried)

    @property
    def up(self) -> Floats:
        """(3,) unit vector against gravity."""
        return _up(self.simulator.gravity)

    def depth(self, u: float) -> float:
        """Return the depth in m at the plan's time u."""
        return float(np.interp(u, self.times, self.depths))

    def lifted(self, u: float) -> float:
        """Return the weight in N at the mouth that the mouth carries at the plan's time u."""
        at_depth = np.abs(self.depths - self.depth(u)) <= _SAME * self.simulator.rod.length
        if not at_depth.any():  # what was at the mouth is inside, and counts there
            return 0.0
        return float(np.interp(u, self.times[at_depth], self.carried[at_depth]))

    def outside(self, depth: float, lifted: float) -> Discretization:
        """Return the Discretization of the DLO that ends at the mouth, without obstacles."""
        around, rod = self.simulator.surroundings, self.simulator.rod
        end = rod.length - depth
        end = next((s for s, _ in rod.point_masses if abs(s - end) <= _SAME * rod.length), end)
        part = before(rod, end)
        mass = _mass_beyond(rod, end)
        loads = (PointLoad(lifted * self.up - mass * around.gravity),)
        part = replace(part, tip_mass=part.tip_mass + mass)
        around = replace(around, rod=part, point_loads=loads)
        size = rod.length / _ELEMENTS
        while end < _FEWEST * size:
            size /= 2  # the nodes stay, so that nothing changes but that there are more
        s = np.arange(int(np.ceil(end / size)) + 1) * size
        s = np.append(s[s < end - _NO_ELEMENT * size], end)
        return Discretization(around, with_breaks(s, around.breaks), 'local', 0)

    def held(self, mesh: Discretization, behind: float) -> Pose:
        """Return the Pose of the material point at the end of `mesh`, `behind` m behind the mouth.

        As if the part in between was free of stress, so that it transmits nothing to the mouth.
        """
        end = mesh.s[-1:]
        turn = self.simulator.rod.natural_strains(end)[0] * behind
        half = Rotation.from_rotvec(0.5 * turn).as_matrix()
        along = self.mouth.rotation @ half @ np.array([behind, 0.0, 0.0])
        return Pose.from_rotation(self.mouth.position + along,
                                  self.mouth.rotation @ half @ half)


def _up(gravity: Floats) -> Floats:
    return -gravity / (np.linalg.norm(gravity) or 1.0)


def _mass_beyond(rod: Rod, end: float) -> float:
    """Return the mass in kg of the part beyond an arc length, m, with all that is fixed to it."""
    if end >= rod.length:
        return 0.0
    rest = part_of_rod(rod, end, 1)
    rest = replace(rest, point_masses=tuple((s, mass) for s, mass in rest.point_masses if s > 0))
    s = with_breaks(np.linspace(0, rest.length, _ELEMENTS + 1), rest.breaks)
    return float(node_masses(rest, s).sum())
