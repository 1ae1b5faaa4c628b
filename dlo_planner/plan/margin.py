# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What uncertainty leaves of the room in a hole: the clearance less the expected miss.

The miss grows as 1 / stability, the clearance falls only as the cosine of the angle at which the
DLO passes. The miss is to first order, under an `Uncertainty`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np

from dlo_planner.direct.grasp import grasped_at
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import BORE
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
    Each hold is off as the gripper is, by an error of its own.
    """
    if not uncertain.size or not shapes:
        return np.zeros((len(shapes), len(s)))
    if shapes[0].holds:
        return np.array([_missed_in_grips(uncertain, shape, s) for shape in shapes])
    slopes, tangents = uncertain.moved(shapes, s)
    slopes = slopes * uncertain.deviations
    along = np.einsum('jki,jkic->jkc', tangents, slopes)
    result: Floats = np.sqrt(np.maximum((slopes**2).sum(axis=(2, 3)) - (along**2).sum(axis=2), 0.0))
    return result


def _missed_in_grips(uncertain: UncertainState, shape: Shape, s: Floats) -> Floats:
    """Return (k,) standard deviations (m) as `expected_misses` does, of a Shape that is held."""
    slopes = uncertain.slopes(np.zeros(uncertain.size), shape)(s) * uncertain.deviations
    slopes = np.concatenate([slopes[:, :, :uncertain.parameters.size],
                             _by_grips(uncertain.uncertainty, shape, s)], axis=2)
    tangents = np.array([shape.frame_at(one)[0][:, 0] for one in s.tolist()])
    along = np.einsum('ki,kij->kj', tangents, slopes)
    result: Floats = np.sqrt(np.maximum((slopes**2).sum(axis=(1, 2)) - (along**2).sum(axis=1), 0.0))
    return result


def _by_grips(uncertainty: Uncertainty, shape: Shape, s: Floats) -> Floats:
    """Return (k, 3, 6 + 6 A) deviations (m) of points at s (k,), m, by the errors of all grips.

    They are the same about any axes.
    """
    sensitivity = Sensitivity(shape)
    deviations = np.repeat((uncertainty.gripper_rotation, uncertainty.gripper_position), 3)
    slopes = np.array([sensitivity.by_grips(one)[3:] for one in s.tolist()])
    result: Floats = slopes * np.tile(deviations, 1 + len(shape.holds))
    return result


def least_margin(uncertainty: Uncertainty | None, shape: Shape, arcs: Sequence[float],
                 clearances: Iterable[Sequence[float] | Floats]) -> float:
    """Return the least margin (m) of a Shape that passes cut-outs at some arc lengths, m.

    The clearances are known of each one that it has come to. nan: none of them has a size, the
    DLO is held in a bore or touches something, or the shape comes from a file. Where the gripper
    holds the DLO inside, the part in front of it is what passes.
    """
    if shape.parts is not None:
        at = grasped_at(shape) or 0.0
        shape, arcs = shape.parts[1], [s - at for s in arcs]
    mesh = shape.state.mesh
    sized = [(s, float(min(rooms))) for s, rooms in zip(arcs, clearances, strict=False)
             if min(rooms) < np.inf]
    if not sized or mesh is None or shape.contacts or any(
            hold.by == BORE for hold in shape.holds):
        return np.nan
    misses, = expected_misses(uncertain_state(mesh.surroundings, uncertainty), [shape],
                              np.array([s for s, _ in sized]))
    return min(room - DEVIATIONS * float(miss)
               for (_, room), miss in zip(sized, misses, strict=True))


def miss_slopes(slopes: PointSlopes, goal: Through) -> tuple[Floats, Floats, Floats]:
    """Return by how much a Shape misses a point, (3,) m, and the derivatives (3, n) of that.

    They are across the DLO, which may pass elsewhere along itself; (3, 3) is what is across.
    """
    s, (off, tangent, _) = goal.nearest(slopes.shape)
    across = np.eye(3) - np.outer(tangent, tangent)
    return off, across @ slopes(np.array([s]))[0], across
