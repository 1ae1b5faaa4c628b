# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By how much a DLO that is led through fittings misses their mouths, when things differ.

The gripper, what holds the DLO at first, and each fitting are off by an error of their own, the
same all the way; the DLO is off as stated. A fitting closes about whatever place of the DLO has
come to lie in it. While the plan has the DLO in a mouth, a miss is how far aside it passes the
mouth's middle, else how far the place of the DLO goes that goes farthest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.entries import centered
from dlo_planner.inverse.tasks.route import Fitting, aim_at, closed, names_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Holds
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import clearance
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.plan import Plan
from dlo_planner.uncertainty.state import UncertainState, stretched
from dlo_planner.verify.held_robustness import Mouth, off

_STANDS = 1e-5   # of the length: a hand that gives way by less does not
_YIELDS = 0.05   # of the length: one that does by more has lost the DLO


class Entry(NamedTuple):
    """What the Fittings of a Route do at a waypoint, by their indices; None: nothing."""

    closes: int | None  # about the DLO, before the gripper goes there
    inside: int | None  # has the DLO in its mouth
    below: int | None   # the one above which the DLO stops to be looked at
    ahead: int          # the first one that the DLO keeps out of


class RouteWork(NamedTuple):
    """What samples need."""

    uncertain: UncertainState
    shapes: Sequence[Shape]      # of the plan, n
    fittings: Sequence[Fitting]  # F
    entries: Sequence[Entry]     # n
    obstacles: Sequence[Obstacle]
    stiffness: float             # N/m, of the hand
    draws: Floats                # (m, 1 + A + F, k) of DLO and gripper, A holds at first, fittings
    errors: Floats               # (m, F, l, 2) of l looks from above each fitting, m


def entries_of(plan: Plan, fittings: Sequence[Fitting]) -> list[Entry]:
    """Return the n Entries of a Plan with all Fittings of its Route; raise InvalidTask."""
    names, stages = names_of(fittings), plan.stages
    held = [{hold.by for hold in stage.shapes[0].holds} for stage in stages]
    closing = [sorted(after - before) for before, after in zip(held, [*held[1:], held[-1]],
                                                               strict=True)]
    if [name for some in closing for name in some] != names:
        raise InvalidTask(f'fittings are {", ".join(names)}: expected those that close in this '
                          f'plan, in their order: {", ".join(sum(closing, [])) or "none"}')
    surface, found, count, closes = _surface(plan.shapes[0]), list[Entry](), 0, None
    for stage, some in zip(stages, closing, strict=True):
        for k, shape in enumerate(stage.shapes):
            inside = bool(some) and (k == len(stage) - 1 or _in_mouth(
                shape, fittings[count], surface))
            below = bool(some) and 0 < k < len(stage) - 1 and stage.first + k in plan.stops
            found.append(Entry(closes if k == 0 else None, count if inside else None,
                               count if below else None, count + len(some)))
        closes = count if some else None
        count += len(some)
    return found


def mouths_of(plan: Plan, fittings: Sequence[Fitting],
              entries: Sequence[Entry]) -> list[Mouth | None]:
    """Return the n Mouths in which the DLO is, or None where it is in none."""
    inside = [entry.inside for entry in entries] or [None] * len(plan)
    return [None if at is None else Mouth(
        fittings[at].pose.rotation[:, 0], fittings[at].aside, aim_at(fittings[at]).level(shape))
        for shape, at in zip(plan.shapes, inside, strict=True)]


def rooms_of(fittings: Sequence[Fitting], entries: Sequence[Entry]) -> Floats:
    """Return (n,) the room aside of a DLO in a mouth, m; infinite elsewhere."""
    return np.array([np.inf if entry.inside is None else fittings[entry.inside].room
                     for entry in entries])


def passed_at(shape: Shape, fitting: Fitting) -> Floats:
    """Return (2,) where a Shape passes a Fitting: aside of its middle, and out of its seat, m."""
    place = shape.frame_at(aim_at(fitting).level(shape))[1] - fitting.pose.position
    return np.array([place @ fitting.aside, place @ fitting.outwards])


def _surface(shape: Shape) -> Surface:
    return Surface() if shape.rod is None else Surface.of(shape.rod)


def _in_mouth(shape: Shape, fitting: Fitting, surface: Surface) -> bool:
    """Whether a Shape is as deep in a Fitting as it reaches out of its seat."""
    return fitting.size is not None and bool(
        passed_at(shape, fitting)[1] < 0.5 * fitting.size[2] + surface.bound)


def sampled(work: RouteWork) -> tuple[Floats, Floats]:
    """Return misses (m, n) of the samples, and their least distances (m,) from all around, m.

    Each sample is followed through the plan, until it leaps or has no stable shape: its misses are
    infinite from then on.
    """
    ends = [_followed(work, z, [work.uncertain.offset(one) for one in (z, *others)], errors)
            for (z, *others), errors in zip(work.draws, work.errors, strict=True)]
    return (np.array([misses for misses, _ in ends]).reshape(len(ends), len(work.shapes)),
            np.array([room for _, room in ends]))


def _followed(work: RouteWork, z: Floats, offsets: Sequence[Pose],
              errors: Floats) -> tuple[Floats, float]:
    """Return misses (n,) of one DLO, and its least distance from all around, m."""
    drawn, shapes = work.uncertain.simulator, work.shapes
    if work.uncertain.parameters.size:
        drawn = drawn.with_rod(work.uncertain.rod(z))
    count, surface = 1 + len(shapes[0].holds), Surface.of(drawn.rod)
    fittings = [replace(one, pose=one.pose.compose(offset))
                for one, offset in zip(work.fittings, offsets[count:], strict=True)]
    names = names_of(fittings)
    bodies = [one.body(name) for one, name in zip(fittings, names, strict=True)]
    holds = off(shapes[0], offsets[:count])[1]
    before = stretched(shapes[0], drawn.rod.length)
    misses, room, gives = np.full(len(shapes), np.inf), np.inf, 0.0
    off_by = np.zeros(2)  # of the mouth, as far as it has been seen, m

    def led() -> tuple[Shape | None, float]:
        """Return the next Shape, what was seen taken away, and by how much the hand gives way."""
        gripper = planned.gripper
        if off_by.any():
            gripper = displaced(gripper, centered(planned, work.fittings[entry.ahead - 1], off_by))
        return _led(drawn, gripper.compose(offsets[0]), holds, before, planned.gripper_wrench[:3],
                    work.stiffness, gives)

    for k, (planned, entry) in enumerate(zip(shapes, work.entries, strict=True)):
        if entry.closes is not None:
            fitting = fittings[entry.closes]
            holds = closed(drawn, before, fitting, aim_at(fitting).level(before),
                           names[entry.closes])
            off_by = np.zeros(2)
        reached, gives = led()
        for error in errors[entry.below] if entry.below is not None else ():
            if reached is None or entry.below is None:
                break
            off_by = off_by + error + passed_at(reached, fittings[entry.below]) - passed_at(
                planned, work.fittings[entry.below])
            reached, gives = led()
        if reached is None or k > 0 and reached.jumped:
            break
        around = [*work.obstacles, *(body for some in bodies[entry.ahead:] for body in some)]
        if around:
            room = min(room, clearance(around, surface, reached))
        misses[k] = (apart(reached, planned) if entry.inside is None else
                     abs(passed_at(reached, fittings[entry.inside])[0]))
        before, holds = reached, reached.holds
    return misses, room


def _led(drawn: DirectSimulator, gripper: Pose, holds: Holds, before: Shape, fed: Floats,
         stiffness: float, guess: float) -> tuple[Shape | None, float]:
    """Return the Shape that a hand leads to `gripper`, and by how much it gives way, m.

    It exerts a force `fed` (3,), N, there, and gives way along the straight line to what holds the
    DLO next to it, which alone pulls strongly. None: it finds no shape.
    """
    known = dict[float, Shape]()

    def excess(by: float) -> float:
        """Return what pulls more than the hand holds where it gives way by so much, N."""
        found = drawn.track([Pose(gripper.position + by * along, gripper.quaternion)],
                            initial=before, holds=[holds])[0]
        if not found.converged:  # out of reach
            return stiffness * most
        known[by] = found
        return float((found.gripper_wrench[:3] - fed) @ along) + stiffness * by

    along, most, exact = np.zeros(3), _YIELDS * drawn.rod.length, _STANDS * drawn.rod.length
    if not holds or stiffness == np.inf:
        excess(0.0)
        return known.get(0.0), 0.0
    along = gripper.position - holds[0].pose.position
    along /= np.linalg.norm(along)
    first = excess(guess)
    if guess in known and abs(first) < exact * stiffness:
        return known[guess], guess
    # the more it gives way the less it is pulled, so the excess grows by its stiffness at least
    other, way = guess, first / stiffness if guess in known else exact
    while (other == guess or excess(other) * first > 0.0) and abs(other - guess) < most:
        other, way = other - way, 2.0 * way
    if abs(other - guess) < most:
        other = float(brentq(excess, min(other, guess), max(other, guess), xtol=exact))
    nearest = min(known, key=lambda by: abs(by - other), default=None)
    if nearest is None or abs(nearest - other) > 2.0 * exact:
        return None, guess
    return known[nearest], nearest
