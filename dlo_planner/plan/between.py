# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks between the waypoints of a plan, on the path that the gripper really takes.

The gripper is checked everywhere on the path (`Workspace.first_beyond`). The DLO is known at the
waypoints; in between, its distance from them is bounded. Where the bound is not sufficient, the DLO
is simulated in the middle, and so on.

The bound. A plan draws the DLO along itself and sideways, so shapes are compared as curves, each
prolonged straight by as much as its ends have moved: delta is the distance of a point of one
shape from the other curve, however far it went along. If the DLO went evenly from one curve to the
other, no point of it would be farther than delta / 2 from the nearer of both. It does not go quite
evenly: the gripper leaves the straight line by h^2/8 times the path's second derivative, which is
bounded, and a point that turns about the gripper by an angle goes along an arc of a height of
lever angle^2/8. The lever is the point's distance from the gripper or, if that is larger, its
motion per angle between both shapes: a DLO that is softer than stiff answers a turn by more. Then
the point turns by its motion over its distance, which may be more than the gripper turns, and that
angle counts. A distance from obstacles changes no more than the place does, so if it exceeds
delta / 2 and both bulges at each point of both shapes, nothing is touched between. It is assumed,
not proved, that the DLO responds alike between both ends: a jump is noticed where the DLO is
simulated, and `plan.continuity` checks the straight motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.scene import build_scene
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.clearance import clearance, hole_clearances
from dlo_planner.plan.curve_distance import curve_distances, element_rooms
from dlo_planner.plan.leg import Leg
from dlo_planner.plan.path import GripperPath

if TYPE_CHECKING:
    from dlo_planner.plan.builder import PlanRequirements

SheetSide: TypeAlias = tuple[Sheet, Floats]      # and the normal (3,) from before it to behind it
Violation: TypeAlias = tuple[str, float, str]    # constraint, by how much, in words

_HALVINGS = 7   # of the way between two waypoints
_CLOSER = 4     # looks for where the DLO is deepest in something
_TINY = 1e-12   # of the length: a node in the gripper
_LEAP = 3.0     # motion of the DLO per lever and turn of the gripper: more is no continuation


@dataclass(frozen=True, eq=False)
class Broken:
    """A violation before a waypoint: index of the waypoint, constraint, amount, in words."""

    waypoint: int
    constraint: str
    amount: float
    why: str


def violation_between(path: GripperPath, shapes: Sequence[Shape], sheets: Sequence[SheetSide],
                      demands: PlanRequirements,
                      known: Sequence[float | None] | None = None) -> Broken | None:
    """Return the first violation between the waypoints of a plan, or None."""
    outside = None
    if demands.workspace is not None:
        beyond = demands.workspace.first_beyond(path)
        if beyond is not None:
            outside = Broken(*beyond, 'on the way there the gripper comes '
                             f'{beyond[2]:.3g} m beyond {beyond[1]}')
    if demands.simulator is None or not (sheets or demands.obstacles) or any(
            shape.s[-1] != demands.simulator.rod.length for shape in shapes):
        return outside
    return _Sweep(path, sheets, demands).broken(shapes, known, outside) or outside


@dataclass(frozen=True)
class _Look:
    """A Shape at a parameter of the path, and how much room it has.

    Attributes
    ----------
    u : float
        Parameter.
    shape : Shape
    arms : ndarray, shape (N + 1, 3)
        Vectors in m from the gripper to the nodes.
    levers : ndarray, shape (N + 1,)
        Lengths of the arms, m.
    rooms : ndarray, shape (N,)
        Lower bounds of the room of each element, m.
    least : float
        Least room of all in m, exact.
    """

    u: float
    shape: Shape
    arms: Floats
    levers: Floats
    rooms: Floats
    least: float


class _Sweep:
    """Checks a path, leg by leg, between the waypoints."""

    def __init__(self, path: GripperPath, sheets: Sequence[SheetSide],
                 demands: PlanRequirements) -> None:
        self._path, self._sheets, self._demands = path, sheets, demands
        around = [sheet for sheet, _ in sheets]
        self._others = [obstacle for obstacle in demands.obstacles
                        if not any(obstacle is sheet for sheet in around)]
        self._bodies = [*around, *self._others]
        self._scene = build_scene(self._bodies, demands.surface, sharp=True)

    def broken(self, shapes: Sequence[Shape], known: Sequence[float | None] | None,
               outside: Broken | None) -> Broken | None:
        """Return the first Broken before n Shapes, earlier than `outside`."""
        known = [None] * len(shapes) if known is None else known
        for leg in self._path.legs:
            if leg.still:
                continue
            before, pieces = None, leg.pieces()
            for a, b, bends in zip(*pieces, leg.bounds(*pieces)[:, :, 1], strict=True):
                goal = self._path.goal(b)
                if outside is not None and goal > outside.waypoint:
                    return None
                self._demands.progress.check()
                if before is None:
                    start = np.searchsorted(self._path.times, a, side='right') - 1
                    before = self._look(a, shapes[start], known[start])
                after = self._look(b, shapes[goal], known[goal])
                what = self._between(leg, before, after, bends, _HALVINGS)
                if what is not None:
                    return Broken(goal, *what)
                before = after
        return None

    def _look(self, u: float, shape: Shape, known: float | None = None) -> _Look:
        rooms = [hole_clearances(*sheet, self._demands.surface, shape).min()
                 for sheet in self._sheets] if known is None else [known]
        if self._others:
            rooms.append(clearance(self._others, self._demands.surface, shape))
        least = float(min(rooms))
        arms = shape.positions - shape.gripper.position
        scene, surface = self._scene, self._demands.surface
        if surface.rod is not None:  # on each mesh another one
            scene = build_scene(self._bodies, surface, shape.s, sharp=True)
        return _Look(u, shape, arms, np.sqrt(np.einsum('ij,ij->i', arms, arms)), element_rooms(
            scene, *shape.for_kernels, least), least)

    def _between(self, leg: Leg, one: _Look, other: _Look, bends: Floats,
                 halvings: int) -> Violation | None:
        """Return constraint, amount and words of a violation between two Looks, or None.

        Shapes: bends (2,).
        """
        short, far = _short(one, other, bends)
        if short <= 0:
            return None
        if not halvings:
            if far:
                return 'continuity', far, (f'on the way there the DLO goes {far:.3g} m to where '
                                           'the gripper does not bring it')
            return 'clearance', short, (f'on the way there {short:.3g} m are missing to show that '
                                        'the DLO touches nothing; closer waypoints may help')
        middle, jumped = self._middle(leg, one, other)
        if middle is None:
            return jumped
        if middle.least < 0:
            deepest = self._deepest(leg, one, middle, other)
            return 'clearance', deepest, (f'on the way there the DLO is {deepest:.3g} m in the '
                                          'sheet or an obstacle')
        return (self._between(leg, one, middle, bends, halvings - 1)
                or self._between(leg, middle, other, bends, halvings - 1))

    def _middle(self, leg: Leg, one: _Look, other: _Look) -> tuple[_Look | None, Violation | None]:
        """Return the Look half way between two and None, or None and the violation by a jump."""
        assert self._demands.simulator is not None  # else nothing is checked between waypoints
        u = 0.5 * (one.u + other.u)
        (position,), (rotation,) = leg.poses(np.array([u]))
        shape = self._demands.simulator.track([Pose.from_rotation(position, rotation)],
                                              initial=one.shape)[0]
        if shape.converged and not shape.jumped:
            return self._look(u, shape), None
        away = float(np.linalg.norm(shape.positions[-1] - one.shape.positions[-1]))
        return None, ('continuity', away, 'on the way there the DLO falls into another shape: its '
                      f'free end comes {away:.3g} m away')

    def _deepest(self, leg: Leg, before: _Look, deep: _Look, after: _Look) -> float:
        """Return how deep (m) the DLO is in something near a Look where it is, at the worst."""
        for _ in range(_CLOSER):
            looks = [look for look in (before, self._middle(leg, before, deep)[0], deep,
                                       self._middle(leg, deep, after)[0], after)
                     if look is not None]
            k = min(range(1, len(looks) - 1), key=lambda k: looks[k].least)
            before, deep, after = looks[k - 1:k + 2]
        return -deep.least


def _short(one: _Look, other: _Look, bends: Floats) -> tuple[float, float]:
    """Return by how much (m) room is missing to prove that nothing is touched between two Looks.

    Also how far (m) the DLO moves, if that is more than a turn of the gripper can cause, or 0.
    """
    shift, bend = 0.125 * (other.u - one.u) ** 2 * bends
    turn = angle_between(one.shape.gripper.rotation, other.shape.gripper.rotation)
    length = one.shape.s[-1]
    motion = np.zeros(1)  # seen from the gripper
    if len(one.arms) == len(other.arms):
        motion = np.sqrt(((other.arms - one.arms) ** 2).sum(axis=1))
    moved = float(motion.max())
    lever = moved / max(turn, 1e-9) if moved > 1e-12 * length else 0.0
    short = -np.inf
    for this, that in ((one, other), (other, one)):
        angles = np.maximum(turn, motion / np.maximum(this.levers, _TINY * length))
        away = (0.5 * curve_distances(this.shape, that.shape) + shift
                + np.maximum(this.levers, lever) * bend + this.levers * angles**2 / 8)
        short = max(short, float((np.maximum(away[1:], away[:-1]) - this.rooms).max()))
    return short, moved if moved > _LEAP * length * turn else 0.0
