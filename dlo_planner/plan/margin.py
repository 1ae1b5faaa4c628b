# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What uncertainty leaves of the room in a hole: the clearance less the expected miss.

The miss grows as 1 / stability, the clearance falls only as the cosine of the angle at which the
DLO passes. The miss is to first order, under an `Uncertainty`.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from dlo_planner.direct.grasp import grasped_at
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import BORE, place_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.model.supports import Surroundings
from dlo_planner.plan.goals import Through
from dlo_planner.uncertainty.parameters import VARIATION, Uncertainty
from dlo_planner.uncertainty.state import PointSlopes, UncertainState

DEVIATIONS = 2.0  # standard deviations of the miss that a margin leaves room for
_TINY = 1e-12     # of a room


def rating(clearance: Floats, margin: Floats, room: float) -> Floats:
    """Return (n,) how well a DLO passes: its margin as a part of the room (m) of an upright one.

    Where no margin is left, what the clearance lacks of two standard deviations, as a part of them,
    down to -1: so a DLO that has hardly any clearance, but is known better, is never the best.

    Shapes: clearance, margin (n,), m.
    """
    lacking = margin / np.maximum(clearance - np.minimum(margin, 0), _TINY * room)
    return np.where(margin >= 0, margin / room, lacking)


def usual_uncertainty(rod: Rod) -> Uncertainty:
    """Return the Uncertainty of a DLO that was weighed and bent, in a robot that is calibrated."""
    return Uncertainty(bending_stiffness=0.02, mass=0.01, natural_curvature=0.004 / rod.length,
                       gripper_position=0.001 * rod.length, gripper_rotation=0.001)


def unseen(rod: Rod) -> Uncertainty:
    """Return the part of the usual Uncertainty that looks do not reduce: where the gripper goes."""
    usual = usual_uncertainty(rod)
    return Uncertainty(gripper_position=usual.gripper_position,
                       gripper_rotation=usual.gripper_rotation)


def upright_room(cutout: CutOut, surface: Surface) -> float:
    """Return the room (m) in a CutOut of a DLO that passes its center upright; inf: no size.

    Of a rectangular DLO, at any roll; if there is none, at the best roll.
    """
    half = cutout.radius if cutout.radius is not None else (
        np.inf if cutout.width is None or cutout.height is None
        else 0.5 * min(cutout.width, cutout.height))
    return half - surface.bound if half > surface.bound else half - surface.least


@lru_cache(maxsize=4)
def uncertain_state(around: Surroundings, uncertainty: Uncertainty | None) -> UncertainState:
    """Return the UncertainState of a DLO that hangs freely; None: the usual Uncertainty."""
    uncertainty = uncertainty or usual_uncertainty(around.rod)
    return UncertainState(DirectSimulator(
        around.rod, gravity=around.gravity, load=around.load, point_loads=around.point_loads),
        uncertainty, 1 + VARIATION)


def expected_misses(uncertain: UncertainState, shapes: Sequence[Shape], s: Floats) -> Floats:
    """Return (n, k) standard deviations (m) of where n Shapes pass their points at s (k,), m.

    Across the DLO, which may pass elsewhere along itself: the root of the sum over both directions.
    Each hold is off as the gripper is, by an error of its own: see `GripErrors`.
    """
    if not uncertain.size or not shapes:
        return np.zeros((len(shapes), len(s)))
    if shapes[0].holds:
        return np.array([GripErrors(uncertain.uncertainty).misses(shape, s) for shape in shapes])
    slopes, tangents = uncertain.moved(shapes, s)
    slopes = slopes * uncertain.deviations
    along = np.einsum('jki,jkic->jkc', tangents, slopes)
    result: Floats = np.sqrt(np.maximum((slopes**2).sum(axis=(2, 3)) - (along**2).sum(axis=2), 0.0))
    return result


Blocks: TypeAlias = dict[Hashable, Floats]  # (r, k) deviations by k numbers that are independent


class GripErrors:
    """What a DLO and its grips are off by along a plan, to first order, by independent numbers.

    Each grip that holds it at first is off by an error of its own, as the gripper is: rotation and
    displacement in its own frame, the same wherever it goes. A hand that closes later takes the DLO
    where it is: what the DLO is off by at that place stays in the hand, and goes along with it. How
    exactly a hand goes from there on is not counted.

    Of a DLO that is grasped inside, what is not known of either part is independent.
    """

    def __init__(self, uncertainty: Uncertainty) -> None:
        self._uncertainty = uncertainty
        # of each grip: twists, 6 rows, and the rotation of the grip when it had them
        self._grips: dict[Hashable, tuple[Blocks, Floats]] = {}
        self._last: Shape | None = None

    def copy(self) -> GripErrors:
        """Return the same, which goes another way from here."""
        other = GripErrors(self._uncertainty)
        other._grips, other._last = dict(self._grips), self._last
        return other

    def follow(self, shape: Shape) -> None:
        """Go on to the next Shape, in which other hands may hold the DLO."""
        there, last = _grips_of(shape), self._last
        known = {key: self._grips[key] for key in there if key in self._grips}
        for key, (s, pose) in there.items():
            if key not in known:
                known[key] = (self._own(key) if last is None else self._twists(last, s),
                              pose.rotation)
        self._grips, self._last = known, shape

    def misses(self, shape: Shape, s: Floats) -> Floats:
        """Return (k,) standard deviations (m) of where a Shape passes its points at s (k,), m.

        Across the DLO. A Shape that it has not come to is held by nothing that closed later.
        """
        if not shape.holds and shape.parts is None:
            found: Floats = expected_misses(self._state(shape), [shape], s)[0]
            return found
        if shape is not self._last:
            alone = GripErrors(self._uncertainty)
            alone.follow(shape)
            return alone.misses(shape, s)
        out = np.empty(s.size)
        for k, at in enumerate(s.tolist()):
            tangent = shape.frame_at(at)[0][:, 0]
            moved = np.hstack([block[3:] for block in self._twists(shape, at).values()])
            out[k] = np.sqrt(max(0.0, float((moved**2).sum() - ((tangent @ moved)**2).sum())))
        return out

    def _own(self, key: Hashable) -> Blocks:
        return {key: np.diag(np.repeat((self._uncertainty.gripper_rotation,
                                        self._uncertainty.gripper_position), 3))}

    def _state(self, part: Shape) -> UncertainState:
        assert part.state.mesh is not None  # of a simulator
        return uncertain_state(part.state.mesh.surroundings, self._uncertainty)

    def _twists(self, shape: Shape, s: float) -> Blocks:
        """Return the twists, 6 rows, rad and m, world axes, of the frame at `s`, m."""
        part, local, side = _part_at(shape, s)
        uncertain, sensitivity = self._state(part), Sensitivity(part)
        n = uncertain.parameters.size
        slopes = uncertain.slopes(np.zeros(uncertain.size), part)
        found: Blocks = {side: np.vstack([
            _turns(slopes, local)[:, :n], slopes(np.array([local]))[0, :, :n]
        ]) * uncertain.deviations[:n]}
        answers = sensitivity.by_grips(local)
        grips = _grips_of(shape)
        own, *beyond = grips if shape.parts is None or side[1] == FRONT else [next(iter(grips))]
        for k, key in enumerate((own, *beyond)):
            errors, then = self._grips[key]
            turn = np.kron(np.eye(2), grips[key][1].rotation @ then.T)
            for name, block in errors.items():
                moved = answers[:, 6 * k:6 * k + 6] @ turn @ block
                found[name] = found[name] + moved if name in found else moved
        return found


BACK_PART, FRONT = 'back', 'front'


def _grips_of(shape: Shape) -> dict[Hashable, tuple[float, Pose]]:
    """Return place, m, and Pose of all grips of a Shape, by arc length: by name and place.

    The gripper first; where it is one of the hands it goes by that name.
    """
    at = grasped_at(shape) or 0.0
    holds: dict[Hashable, tuple[float, Pose]] = {
        (hold.by, hold.s): (place_of(hold, float(shape.s[-1])), hold.pose) for hold in shape.holds}
    if at and any(place == at for place, _ in holds.values()):
        return holds
    return {(None, at): (at, shape.gripper), **holds}


def _part_at(shape: Shape, s: float) -> tuple[Shape, float, tuple[float, str]]:
    """Return the part of a Shape that has its place at `s`, m, where that is in it, and a name."""
    at = grasped_at(shape)
    if shape.parts is None or at is None:
        return shape, s, (0.0, FRONT)
    back, on = shape.parts
    return (on, s - at, (at, FRONT)) if s >= at else (back, at - s, (at, BACK_PART))


def _turns(slopes: PointSlopes, s: float) -> Floats:
    """Return (3, n) the turns of the frame at `s`, m, world axes, with what bends the Shape."""
    shape, out = slopes.shape, np.zeros((3, slopes.size))
    for e in np.flatnonzero(shape.s[:-1] < s).tolist():
        own = shape.element_strains[e]
        part = min(s, shape.s[e + 1]) - shape.s[e]
        changes = slopes.strains[:, e] + slopes.stretch[:, e, None] * own
        out[:, slopes.bent] += shape.frames[e] @ left_jacobian(part * own) @ (part * changes).T
    return out


def least_margin(uncertainty: Uncertainty | None, shape: Shape, arcs: Sequence[float],
                 clearances: Iterable[Sequence[float] | Floats],
                 errors: GripErrors | None = None) -> float:
    """Return the least margin (m) of a Shape that passes cut-outs at some arc lengths, m.

    The clearances are known of each one that it has come to. nan: none of them has a size, the
    DLO is held in a bore or touches something, or the shape comes from a file. `errors`: of a plan
    that has come to it, in which hands close; None: each grip is off by an error of its own.
    """
    if shape.parts is not None and not shape.holds and errors is None:
        at = grasped_at(shape) or 0.0  # the part in front of the gripper is what passes
        shape, arcs = shape.parts[1], [s - at for s in arcs]
    mesh = shape.state.mesh
    sized = [(s, float(min(rooms))) for s, rooms in zip(arcs, clearances, strict=False)
             if min(rooms) < np.inf]
    if not sized or mesh is None or shape.contacts or any(
            hold.by == BORE for hold in shape.holds):
        return np.nan
    places = np.array([s for s, _ in sized])
    if errors is None and not shape.holds:
        misses, = expected_misses(uncertain_state(mesh.surroundings, uncertainty), [shape], places)
    else:
        misses = (errors or GripErrors(uncertainty or usual_uncertainty(mesh.rod))).misses(
            shape, places)
    return min(room - DEVIATIONS * float(miss)
               for (_, room), miss in zip(sized, misses, strict=True))


def miss_slopes(slopes: PointSlopes, goal: Through) -> tuple[Floats, Floats, Floats]:
    """Return by how much a Shape misses a point, (3,) m, and the derivatives (3, n) of that.

    They are across the DLO, which may pass elsewhere along itself; (3, 3) is what is across.
    """
    s, (off, tangent, _) = goal.nearest(slopes.shape)
    across = np.eye(3) - np.outer(tangent, tangent)
    return off, across @ slopes(np.array([s]))[0], across
