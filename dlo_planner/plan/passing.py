# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a DLO is from the centers that it has to pass, at and between a plan's waypoints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats

if TYPE_CHECKING:
    from dlo_planner.plan.plan import Plan

_PRESSED = 1e-3       # of the force of a contact as planned: with less it is lost
_NEWTON = 4           # steps to the point of the DLO that is nearest to a center

# An entry of `Plan.via_points`: center (3,), m; arc length, m; normal (3,) or None.
Passes: TypeAlias = Sequence[tuple[Floats, float, Floats | None]]


def worst_miss(shape: Shape, passes: Passes, later: Passes) -> float:
    """Return the largest distance in m of a Shape from the centers to be passed, 0 if none is."""
    return max(_misses(shape, passes, later), default=0.0)


def _misses(shape: Shape, passes: Passes, later: Passes) -> Iterator[float]:
    """Yield the distances in m of a Shape from the centers to be passed between two waypoints."""
    for center, s, _ in passes:
        then = arc_length_at(center, later)
        if then is not None:
            yield _distance(shape, center, min(s, then), max(s, then))[0]
    # a center in one of both alone counts while the free end is beyond it
    for some, others in ((passes, later), (later, passes)):
        for center, s, _ in some:
            if arc_length_at(center, others) is None:
                away, at = _distance(shape, center, s, shape.s[-1])
                if at < shape.s[-1]:
                    yield away


def arc_length_at(center: Floats | None, passes: Passes) -> float | None:
    """Return the arc length (m) at which the DLO has to pass a center, None if it has not."""
    if center is None:
        return None
    return next((s for other, s, _ in passes if np.array_equal(other, center)), None)


def _distance(shape: Shape, center: Floats, low: float, high: float) -> tuple[float, float]:
    """Return the least distance of a DLO from a center between two arc lengths, and where; m."""
    best = np.inf, low
    for begin in (low, 0.5 * (low + high), high):
        s = begin
        for _ in range(_NEWTON):
            axes, position = shape.frame_at(s)
            away = float(np.linalg.norm(position - center))
            if away < best[0]:
                best = away, s
            s = min(max(s + float(axes[:, 0] @ (center - position)), low), high)
    return best


def first_center(passes: Iterable[Passes]) -> Floats | None:
    """Return the center (3,) that a plan's waypoints pass first, None if none does."""
    return next((one[0][0] for one in passes if one), None)


def arc_lengths_at(center: Floats | None, passes: Iterable[Passes]) -> Floats:
    """Return (n,) the arc lengths in m at which a center or None is passed, nan where it is not."""
    return np.array([np.nan if s is None else s
                     for s in (arc_length_at(center, one) for one in passes)])


def holes_passed(plan: Plan, u: Floats) -> Floats:
    """Return (k, n) arc lengths (m) that pass the k centers of a Plan at parameters u (n,).

    nan before the first waypoint that passes a center, and after the last one.
    """
    centers: list[Floats] = []
    for passes in plan.via_points:
        centers += [center for center, _, _ in passes
                    if not any(np.array_equal(center, one) for one in centers)]
    out = np.full((len(centers), len(u)), np.nan)
    for row, center in zip(out, centers, strict=True):
        s = [arc_length_at(center, passes) for passes in plan.via_points]
        known = np.array([k for k, one in enumerate(s) if one is not None])
        times = plan.times[known]
        inside = (u >= times[0]) & (u <= times[-1])
        row[inside] = np.interp(u[inside], times, [s[k] for k in known])
    return out


def held_after(plan: Plan) -> int | None:
    """Return the index of the waypoint after which a bore holds the DLO of a Plan; None: none."""
    held = [shape.far_end is not None for shape in plan.shapes]
    return max(held.index(True) - 1, 0) if any(held) else None


def contact_lost(plan: Plan, u: Floats, shapes: Sequence[Shape]) -> float:
    """Return which part of some Shapes do not touch what a Plan touches there; nan: nothing.

    An obstacle counts between two waypoints that both touch it, whatever its friction is, and is
    touched by a thousandth of the force there.

    Shapes: u (n,).
    """
    forces = [_pushes(shape) for shape in plan.shapes]
    last = np.clip(np.searchsorted(plan.times, u, side='right') - 1, 0, len(plan) - 1)
    later = np.minimum(last + (u > plan.times[last]), len(plan) - 1)
    kept = []
    for k, j, shape in zip(last, later, shapes, strict=True):
        least = {body: _PRESSED * min(force, forces[j][body])
                 for body, force in forces[k].items() if body in forces[j]}
        if least:
            there = _pushes(shape)
            kept.append(all(there.get(body, 0.0) > force for body, force in least.items()))
    return 1 - float(np.mean(kept)) if kept else np.nan


def _pushes(shape: Shape) -> dict[Any, float]:
    """Return how strongly obstacles, as if without friction, or their indices push a Shape, N."""
    bodies, forces = shape.obstacles, dict[Any, float]()
    for contact in shape.contacts:
        body = replace(bodies[contact.obstacle], friction=0.0) if bodies else contact.obstacle
        forces[body] = forces.get(body, 0.0) + contact.force
    return forces


def means_to_touch(plan: Plan) -> bool:
    """Whether a Plan has contacts, or a bore that holds the DLO."""
    return any(shape.contacts or shape.far_end is not None for shape in plan.shapes)
