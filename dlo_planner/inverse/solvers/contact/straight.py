# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Drawing a DLO over an obstacle along a straight line (paper, section 5.3, footnote 19).

The gripper goes straight from where the contact begins towards the contact, its orientation kept.
The one unknown is how far it has gone; it is found for each arc length that is to touch. Place and
direction of the contact follow from the direct simulation, and drift.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.solvers.contact.family import ContactFamily
from dlo_planner.inverse.solvers.contact.hold_and_slide import first_choice
from dlo_planner.inverse.solvers.contact.touching import ContactProblem
from dlo_planner.model.pose import Pose
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import waypoint_at

if TYPE_CHECKING:
    from dlo_planner.inverse.tasks.slide_contact import SlideContact

_ARC_ERROR = 1e-6     # of the length: how exactly an arc length touches
_HOP = 5e-3       # of the length: so far a contact may hop where it passes a node
_TRIALS = 60
_LONGEST = 0.03   # of the length: a step of the arc length that touches
_SAME = 1e-10     # of the way: places that are one


def slide_straight(simulator: DirectSimulator, task: SlideContact, start: Pose | None,
                   demands: PlanRequirements) -> Plan:
    """Return the Plan of a straight SlideContact; see `InverseSimulator.slide_contact`."""
    lengths = task.lengths
    problem = ContactProblem.at(simulator, task.contact, lengths[0], demands, task.min_force)
    builder = PlanBuilder([simulator.rod.length - s for s in lengths], problem.demands)
    parts = problem.parts(task.forces, builder)
    _, shape = first_choice(problem, parts, task.condition, start, builder)
    builder.add(problem.waypoint(shape))
    slide = _Slide(simulator, problem.family, shape, demands.progress.check)
    gone = 0.0
    for s in lengths[1:]:
        shape, gone = slide.to(s, shape, gone, builder)
        builder.add(waypoint_at(shape, problem.family.place, slide.touches_at(shape, s),
                                problem.family.frame[:, 0]))
    return builder.finished()


class _Trial(NamedTuple):
    """A place of the gripper that was tried.

    Attributes
    ----------
    gone : float
        Part of the straight way.
    left : float
        Arc length that is left to the one wanted, m: positive before it, negative beyond it; nan
        where the DLO does not follow or does not touch.
    shape : Shape
    """

    gone: float
    left: float
    shape: Shape


class _Slide:
    """The straight line from the first Shape to the contact; `gone` is a part of it, 1 the end."""

    def __init__(self, simulator: DirectSimulator, family: ContactFamily, first: Shape,
                 check: Callable[[], None]) -> None:
        self._simulator, self._obstacle, self._check = simulator, family.obstacle, check
        self._first, self._displacement = first.gripper, family.place - first.gripper.position
        self._length = simulator.rod.length

    def to(self, s: float, shape: Shape, gone: float, builder: PlanBuilder) -> tuple[Shape, float]:
        """Return the Shape that touches at arc length `s`, m, and how far the gripper went."""
        touching, longest = self.touches_at(shape, s), _LONGEST * self._length
        for target in np.linspace(touching, s, int(np.ceil(abs(s - touching) / longest)) + 1)[1:]:
            shape, gone = self._step(target, shape, gone, touching, builder)
            touching = self.touches_at(shape, target)
        return shape, gone

    def touches_at(self, shape: Shape, s: float) -> float:
        """Return the arc length in m, nearest to `s`, at which a Shape touches; nan: nowhere."""
        touching = [one.s for one in shape.contacts if one.obstacle == self._obstacle]
        return float(min(touching, key=lambda one: abs(one - s), default=np.nan))

    def _at(self, gone: float, before: Shape) -> Shape:
        """Return the Shape that follows the Shape `before` when the gripper has `gone` so far."""
        gripper = Pose.from_rotation(self._first.position + gone * self._displacement,
                                     self._first.rotation)
        return self._simulator.track([gripper], initial=before)[0]

    def _step(self, target: float, before: Shape, gone: float, touching: float,
              builder: PlanBuilder) -> tuple[Shape, float]:
        """Return the Shape that touches at `target`, m, and how far the gripper has gone.

        The nearer the gripper is, the less of the DLO is left: a root is bracketed and found. All
        trials go on from the Shape `before`, which touches at `touching` (m): friction remembers.
        """
        sign = np.sign(touching - target)
        near: _Trial = _Trial(gone, float(abs(touching - target)), before)
        far: _Trial | None = None
        trial = 1 - (1 - gone) * target / touching
        for _ in range(_TRIALS):
            self._check()
            shape = self._at(trial, before)
            left = sign * (self.touches_at(shape, target) - target)
            tested = _Trial(trial, left if self._follows(shape) else np.nan, shape)
            if abs(tested.left) <= _ARC_ERROR * self._length:
                return shape, trial
            if tested.left > 0:
                near, before_that = tested, near
            else:
                far, before_that = tested, near
            trial = _next(near, far, before_that)
            if far is not None and abs(far.gone - near.gone) < _SAME:
                break
        return self._hopped(near, far, target, builder)

    def _hopped(self, near: _Trial, far: _Trial | None, target: float,
                builder: PlanBuilder) -> tuple[Shape, float]:
        """Return the trial nearest to `target` if no Shape touches there; raise Infeasible."""
        known = [one for one in (near, far) if one is not None and not np.isnan(one.left)]
        gone, left, shape = min(known, key=lambda one: abs(one.left))
        if abs(left) <= _HOP * self._length:
            return shape, gone  # from one side of a node to the other
        if far is not None and np.isnan(far.left) and not np.isnan(
                self.touches_at(far.shape, target)):
            raise builder.refusal('continuity', apart(far.shape, near.shape), 'the DLO would fall '
                                  f'into another shape before it touches at s = {target:.4g} m')
        raise builder.refusal('contact', abs(left), 'the DLO does not come to touch at s = '
                              f'{target:.4g} m on the straight way, at best {abs(left):.3g} m off')

    def _follows(self, shape: Shape) -> bool:
        return shape.converged and not shape.jumped


def _next(near: _Trial, far: _Trial | None, before: _Trial) -> float:
    """Return the next `gone` to be tried: between two trials, or beyond one."""
    if far is None:  # straight on through the last two, at most three times as far
        step, slope = near.gone - before.gone, before.left - near.left
        return near.gone + step * min(max(near.left / slope if slope > 0 else 2.0, 0.1) * 1.1, 2.0)
    if np.isnan(far.left):
        return 0.5 * (near.gone + far.gone)
    share = near.left / (near.left - far.left)
    # a straight line, but never next to an end: a hop is no line
    return near.gone + min(max(share, 0.05), 0.95) * (far.gone - near.gone)
