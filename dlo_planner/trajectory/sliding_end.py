# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion of a DLO that is pushed into a bore: the part outside gets shorter.

The bore is tight and smooth. At the entrance the DLO keeps the entrance's direction and roll and
slides along it freely. The walls carry the weight of the part inside, as the plan assumes; its
inertia along the bore counts, as a mass at the entrance. The DLO is simulated up to the material
point that is at the entrance as a short piece of the motion begins. While this point goes in, it is
held as if the DLO behind the entrance was free of stress. Then the DLO is cut anew: positions,
strains and velocities of the rest go on as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.boundary_motion import BoundaryMotion, GripTrajectory
from dlo_planner.direct.discretization import Discretization, with_breaks
from dlo_planner.direct.dynamics import IntegrationOptions, first_shape, run
from dlo_planner.direct.equilibrium import equilibrium
from dlo_planner.direct.grips import between
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.stepper import Stepper, TimePoint
from dlo_planner.energy.loads import node_masses
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, before, part_of_rod
from dlo_planner.model.supports import PointLoad
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import Progress

_ELEMENTS, _FEWEST = 64, 24  # of the whole DLO, of what is left of it
_SAME = 1e-12      # of the length
_NO_ELEMENT = 0.02  # of an element: a shorter one at the entrance is none


@dataclass(frozen=True)
class Feed:
    """How a plan pushes a DLO into a bore."""

    simulator: DirectSimulator  # of the whole DLO
    entrance: Pose  # Pose, x axis into the bore
    times: Floats  # (n,) times of the plan, s
    depths: Floats  # (n,) depths in m
    # (n,) part of the weight at the entrance that the entrance carries, N, against gravity
    carried: Floats

    @classmethod
    def of(cls, simulator: DirectSimulator, plan: Plan) -> Feed:
        """Return that of a Plan in which a bore holds the DLO."""
        held = [shape.far_end is not None for shape in plan.shapes]
        entrance = next(shape.far_end.pose for shape in plan.shapes if shape.far_end is not None)
        up = _up(simulator.gravity)
        carried = np.array([shape.far_wrench[:3] @ up if inside else 0.0
                            for shape, inside in zip(plan.shapes, held, strict=True)])
        return cls(simulator.elastic().without_obstacles(), entrance, plan.times, plan.depths,
                   carried)

    @property
    def up(self) -> Floats:
        """(3,) unit vector against gravity."""
        return _up(self.simulator.gravity)

    def depth(self, u: float) -> float:
        """Return the depth in m at the plan's time u."""
        return float(np.interp(u, self.times, self.depths))

    def lifted(self, u: float) -> float:
        """Return the weight in N at the entrance that the entrance carries at the plan's time u."""
        at_depth = np.abs(self.depths - self.depth(u)) <= _SAME * self.simulator.rod.length
        if not at_depth.any():  # what was at the entrance is inside, and counts there
            return 0.0
        return float(np.interp(u, self.times[at_depth], self.carried[at_depth]))

    def outside(self, depth: float, lifted: float) -> Discretization:
        """Return the Discretization of the DLO that ends at the entrance, without obstacles."""
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
        """Return the Pose of the point at the end of `mesh`, `behind` m behind the entrance.

        As if the part in between was free of stress, so that it transmits nothing to the entrance.
        """
        end = mesh.s[-1:]
        turn = self.simulator.rod.natural_strains(end)[0] * behind
        half = Rotation.from_rotvec(0.5 * turn).as_matrix()
        along = self.entrance.rotation @ half @ np.array([behind, 0.0, 0.0])
        return Pose.from_rotation(self.entrance.position + along,
                                  self.entrance.rotation @ half @ half)


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


_PIECE = 0.01
_TAKEN_OVER = 0.1  # of a weight, by which the entrance takes it over before
_LONGEST = 50      # instants of a piece
_TOLERANCE = 1e-3  # of the length: of the simulation, as `simulate` has it


@dataclass(frozen=True)
class Outside:
    """The part outside of the bore at n instants, as far as the motion could be simulated."""

    shapes: list[Shape]  # the n shapes in motion
    calm: list[Shape]  # the n shapes, the equilibria in the same gripper
    forces: Floats  # (n,) sizes of the forces that the entrance exerts, N
    converged: bool  # whether every step was solved


@dataclass(frozen=True)
class Instants:
    """What the gripper does at n instants of a motion."""

    grippers: Sequence[Pose]
    u: Floats  # (n,) the plan's times that are reached there
    dt: float  # seconds between two instants

    def part(self, begin: int, end: int | None = None) -> Instants:
        """Return the instants from one index to another, which is left out."""
        return Instants(self.grippers[begin:end], self.u[begin:end], self.dt)


def pushed(feed: Feed, instants: Instants, start: Shape, velocity: Floats | None,
           progress: Progress) -> Outside:
    """Return the part Outside during a motion of the gripper; velocity (N + 1, 3)."""
    grippers, u = instants.grippers, instants.u
    guide = GripTrajectory(grippers, instants.dt, velocity is None)
    shapes, calm, forces, k = [start], [start], [0.0], 0
    while k < len(grippers) - 1:
        count = _instants(feed, u[k:])
        lifted = feed.lifted(u[k])
        mesh = feed.outside(feed.depth(u[k]), lifted)
        if k == 0 and velocity is None:
            strains = mesh.strains_from(start.s, start.element_strains)
            start = calm[-1] = shapes[-1] = equilibrium(mesh, grippers[0], strains,
                                                        holds=(FarEnd(feed.entrance, 'sleeve'),))
        stepper, begun = _begun(feed, mesh, _Later(guide, k), u[k:k + count + 1], start, velocity)
        plan = IntegrationOptions(count + 1, 'generalized_alpha', _TOLERANCE * mesh.s[-1])
        made = run(stepper, begun, plan, progress)
        reached, solved = made.reached, made.status == 'complete'
        for j, now in enumerate(reached[1:], start=1):
            place = feed.held(mesh, feed.depth(u[k + j]) - feed.depth(u[k]))
            still = equilibrium(mesh, now.shape.gripper, np.array(now.shape.element_strains),
                                holds=(FarEnd(place, 'sleeve'),))
            shapes.append(now.shape)
            calm.append(still)
            forces.append(float(np.linalg.norm(now.shape.far_wrench[:3] + lifted * feed.up)))
            solved = solved and still.converged
        if not solved:
            return Outside(shapes, calm, np.array(forces), False)
        k += count
        start, velocity = reached[-1].shape, np.array(reached[-1].velocities)
        progress.check()
    return Outside(shapes, calm, np.array(forces), True)


@dataclass(frozen=True)
class _Later:
    """A GripTrajectory from a later instant on."""

    guide: GripTrajectory
    begin: int

    def at(self, place: float) -> Pose:
        return self.guide.at(self.begin + place)

    def along(self, places: Floats) -> Any:
        return self.guide.along(self.begin + places)


def _instants(feed: Feed, u: Floats) -> int:
    """Return how many of the intervals between parameters u (n,) make the next piece, >= 1."""
    depths, lifted = (np.array([of(one) for one in u[:_LONGEST + 1]])
                      for of in (feed.depth, feed.lifted))
    far = depths - depths[0] > _PIECE * feed.simulator.rod.length
    far |= np.abs(lifted - lifted[0]) > _TAKEN_OVER * max(feed.carried.max(), 1e-300)
    return max(int(np.argmax(far)) - 1, 1) if far.any() else len(depths) - 1


def _begun(feed: Feed, mesh: Discretization, guide: _Later, u: Floats, start: Shape,
           velocity: Floats | None) -> tuple[Stepper, TimePoint]:
    """Return the Stepper of a piece, and the TimePoint at its beginning.

    A DLO that is off the entrance as it comes in is guided there during this piece.
    """
    if velocity is not None:
        velocity = np.column_stack([np.interp(mesh.s, start.s, one) for one in velocity.T])
    # where its end is by these elements: by others it is elsewhere, and would be torn to there
    start = first_shape(mesh, guide.at(0), (), start, None)
    end = Pose.from_rotation(*start.frame_at(float(start.s[-1]))[::-1])
    depths = np.array([feed.depth(one) for one in u])
    shares = np.linspace(0, 1, len(u))
    ends = [_aside(feed.held(mesh, behind), feed.entrance, end, 1 - share**2 * (3 - 2 * share))
            for behind, share in zip(depths - depths[0], shares, strict=True)]
    dt, held = guide.guide.dt, (FarEnd(end, 'sleeve'),)
    grips = BoundaryMotion(guide, [GripTrajectory(ends, dt, False)], held)  # type: ignore[arg-type]  # as a GripTrajectory
    stepper = Stepper(mesh, grips, dt)
    first = first_shape(mesh, guide.at(0), held, start, None)
    return stepper, stepper.begin(first, velocity)


def _aside(pose: Pose, one: Pose, other: Pose, part: float) -> Pose:
    """Return a Pose displaced by a part of the displacement from `one` to `other`."""
    turn = other.rotation @ one.rotation.T
    displaced = Pose.from_rotation(pose.position + other.position - one.position,
                                   turn @ pose.rotation)
    result: Pose = between(pose, displaced, part)
    return result
