# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Following the shapes that do a task from one depth to another, without a leap.

A task leaves the gripper one free rotation, a roll. At each depth the shapes that do it are a curve
on the sphere of all hanging shapes (`inverse.solvers.hanging.sphere`); a step goes to the next
curve, by Newton's method, with no roll or with one that is given.
"""

from typing import NamedTuple, Protocol

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes
from dlo_planner.plan.continuity import excess, refusal_for_leap

_LONGEST_STEP = 1 / 16   # of the length
_SHORTEST_STEP = 1 / 1024
_SHARES = 1.0, 0.5, 0.0  # of a roll


class Passing(NamedTuple):
    """A Shape that does a task at some depth.

    Attributes
    ----------
    shape : Shape
    place : ndarray, shape (3,)
        The gripper's origin from the first center, m.
    second : float or None
        Arc length at a second center, m. None if there is none.
    """

    shape: Shape
    place: np.ndarray
    second: float | None = None

    @property
    def gripper(self) -> tuple[np.ndarray, np.ndarray]:
        """The gripper's rotation (3, 3) and its position (3,) from the first center."""
        return self.shape.gripper.rotation, self.place


class Task(Protocol):
    """What the shapes at a depth have to do."""

    def axis(self, shape: Shape) -> np.ndarray:
        """Return the axis (3,) of the roll that the task leaves free."""

    def at(self, before: Passing, depth: float, roll: float, final: bool) -> Passing | None:
        """Return the Passing at `depth` (m) near `before`, rolled by `roll` (rad), or None.

        Parameters
        ----------
        final : bool
            Whether the passing will be a waypoint.
        """

    def crossings(self, shapes: HangingShapes, depth: float) -> Crossings:
        """Return where the curve of this depth crosses the grid."""


def follow(task, here, depth, wanted, route=None):
    """Continue a Passing from one depth to another, in steps that do not leap.

    Parameters
    ----------
    task
        Task.
    here
        Passing at `depth` (m).
    wanted
        Depth to be reached, m.
    route
        Route that gives the rolls. If None, no roll.

    Returns
    -------
    (Passing or None, float, float)
        The Passing at `wanted`, or None; the depth that was reached; how far the gripper would have
        had to leap there, m (0: no shape was found).
    """
    length = here.shape.s[-1]
    step = longest = _LONGEST_STEP * length
    while True:
        target = depth + float(np.clip(wanted - depth, -step, step))
        roll = 0.0 if route is None else route.roll(task, here, depth, target)
        for share in _SHARES if roll else (1.0,):  # what cannot be rolled at once, is rolled later
            found = task.at(here, target, share * roll, target == wanted)
            too_far = 0.0 if found is None else excess(
                here.gripper, found.gripper, (target - depth) / length, length)
            if found is not None and not too_far:
                break
        if found is not None and not too_far:
            here, depth = found, target
            if depth == wanted:
                return here, depth, 0.0
            step = min(2 * step, longest)
            continue
        if step <= _SHORTEST_STEP * length or target == depth:
            return None, depth, too_far
        step /= 2


def refusal_for_step(simulator, draft, before, found):
    """Return Infeasible if gripper or DLO have to leap to the next waypoint, or None.

    Parameters
    ----------
    before
        Passing of the waypoint before, None at the first.
    found
        Passing of the next one.
    """
    length = found.shape.s[-1]
    too_far = 0.0 if before is None else excess(before.gripper, found.gripper,
                                                draft.step / length, length)
    if too_far:
        return draft.refusal('continuity', too_far, 'the gripper would have to turn or move too '
                             'far since the waypoint before; closer waypoints may help')
    return refusal_for_leap(simulator, draft, found.shape)


def as_replayed(simulator, task, last, here, depth):
    """Return a Passing as a motion from the waypoint before finds it, on the mesh of that motion.

    Which mesh keeps the accuracy depends on the way: the search for a plan takes smaller steps than
    the gripper, some backwards. On another mesh the DLO would miss by as much as the accuracy.

    Parameters
    ----------
    task
        Task.
    last
        Shape before, or None: it begins in its natural shape.
    here
        Passing at `depth` (m).
    """
    if simulator.mesh_after(last) is here.shape.mesh:
        return here
    replayed = simulator.track([here.shape.gripper], initial=last)[0]
    if not replayed.converged or replayed.jumped:
        return here
    found = task.at(here._replace(shape=replayed), depth, 0.0, True)
    return here if found is None else found
