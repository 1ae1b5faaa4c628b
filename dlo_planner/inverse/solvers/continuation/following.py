# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Following the shapes that satisfy a condition from one depth to another, without a leap.

The condition leaves the gripper one free rotation, a roll. At each depth the shapes that satisfy it
are a curve on the sphere of all hanging shapes (`inverse.solvers.hanging.sphere`); a step goes to
the next curve, by Newton's method, with no roll or with a given one.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.continuity import excess, refusal_for_leap

LONGEST_STEP = 1 / 16   # of the length
_SHORTEST_STEP = 1 / 1024
_AHEAD = 4.0             # steps ahead that a trend is believed for
_SHARES = 1.0, 0.5, 0.0  # of a roll


class Passing(NamedTuple):
    """A Shape that satisfies a condition at some depth.

    Attributes
    ----------
    shape : Shape
    place : ndarray, shape (3,)
        The gripper's origin from the first center, m.
    second : float or None
        Arc length at a second center, m. None if there is none.
    depth : float
        Its depth, m; nan: not known.
    since : Passing or None
        The one that it was followed from, without its own. None: not known.
    axes : ndarray, shape (3, 3), or None
        Axes of the DLO at the first center. None: not known.
    """

    shape: Shape
    place: Floats
    second: float | None = None
    depth: float = float('nan')
    since: Passing | None = None
    axes: Floats | None = None

    @property
    def gripper(self) -> tuple[Floats, Floats]:
        """The gripper's rotation (3, 3) and its position (3,) from the first center."""
        return self.shape.gripper.rotation, self.place

    @property
    def known(self) -> tuple[Floats, Floats] | None:
        """Axes and position (3,), m, of the shape at the first center; None: not known."""
        return None if self.axes is None else (self.axes, self.shape.gripper.position - self.place)

    def after(self, before: Passing) -> Passing:
        """Return the same, followed from another one."""
        since = Passing(before.shape, before.place, before.second, before.depth)
        return Passing(self.shape, self.place, self.second, self.depth, since, self.axes)

    def trend(self, depth: float) -> tuple[Shape, float] | None:
        """Return the Shape before on the same mesh, and how many such steps it is to `depth` (m).

        None if it is not known, or not a few steps on.
        """
        if self.since is None or self.since.shape.s is not self.shape.s:
            return None
        ahead = steps_ahead(self.depth - self.since.depth, depth - self.depth)
        return (self.since.shape, ahead) if ahead else None


def steps_ahead(last: float, step: float) -> float:
    """Return how many times the last step (m) a step is; 0 if it is not a few times as long."""
    ahead = step / last if last else 0.0
    return ahead if 0.0 < ahead <= _AHEAD else 0.0


class Condition(Protocol):
    """What the shapes at each depth have to satisfy."""

    def axis(self, shape: Shape) -> Floats:
        """Return the axis (3,) of the roll that the condition leaves free."""

    def at(self, before: Passing, depth: float, roll: float, final: bool) -> Passing | None:
        """Return the Passing at `depth` (m) near `before`, rolled by `roll` (rad), or None."""

    def crossings(self, shapes: HangingShapes, depth: float) -> Crossings:
        """Return where the curve of this depth crosses the grid."""


class Rolls(Protocol):
    """How the gripper rolls from one depth to another."""

    def roll(self, condition: Condition, passing: Passing, depth: float, target: float) -> float:
        """Return the roll (rad) from `depth` to `target`, m."""


class Step(NamedTuple):
    """How far a Passing could be followed.

    Attributes
    ----------
    passing : Passing or None
        The Passing at the depth that was wanted. If None, it was not reached.
    depth : float
        Depth that was reached, m.
    leap : float
        How far the gripper would have to leap there, m; 0: no shape was found beyond it.
    at_once : bool
        Whether it was reached in a single step, in which the gripper does not leap.
    """

    passing: Passing | None
    depth: float
    leap: float
    at_once: bool = False


def follow(condition: Condition, passing: Passing, depth: float, goal: float,
           route: Rolls | None = None) -> Step:
    """Continue a Passing from one depth to another, in steps that do not leap."""
    length = passing.shape.s[-1]
    step = longest = LONGEST_STEP * length
    begun = depth
    while True:
        target = depth + min(max(goal - depth, -step), step)
        roll = 0.0 if route is None else route.roll(condition, passing, depth, target)
        for share in _SHARES if roll else (1.0,):  # what cannot be rolled at once, is rolled later
            candidate = condition.at(passing, target, share * roll, target == goal)
            too_far = 0.0 if candidate is None else excess(
                passing.gripper, candidate.gripper, (target - depth) / length, length)
            if candidate is not None and not too_far:
                break
        if candidate is not None and not too_far:
            at_once = depth == begun
            passing, depth = candidate, target
            if depth == goal:
                return Step(passing, depth, 0.0, at_once)
            step = min(2 * step, longest)
            continue
        if step <= _SHORTEST_STEP * length or target == depth:
            return Step(None, depth, too_far)
        step /= 2


def refusal_for_step(simulator: DirectSimulator, builder: PlanBuilder, before: Passing | None,
                     passing: Passing) -> Infeasible | None:
    """Return Infeasible if gripper or DLO have to leap to the next waypoint, or None."""
    length = passing.shape.s[-1]
    too_far = 0.0 if before is None else excess(before.gripper, passing.gripper,
                                                builder.step / length, length)
    if too_far:
        return builder.refusal('continuity', too_far, 'the gripper would have to turn or move too '
                               'far since the waypoint before; closer waypoints may help')
    return refusal_for_leap(simulator, builder, passing.shape)


def as_replayed(simulator: DirectSimulator, condition: Condition, last: Shape | None,
                passing: Passing, depth: float) -> Passing:
    """Return a Passing as a motion from the waypoint before finds it, on the mesh of that motion.

    Which mesh keeps the accuracy depends on the way: the search for a plan takes smaller steps than
    the gripper, some backwards. On another mesh the DLO would miss by as much as the accuracy.
    """
    if simulator.mesh_after(last) is passing.shape.mesh:
        return passing
    replayed = simulator.track([passing.shape.gripper], initial=last)[0]
    if not replayed.converged or replayed.jumped:
        return passing
    corrected = condition.at(passing._replace(shape=replayed), depth, 0.0, True)
    return passing if corrected is None else corrected
