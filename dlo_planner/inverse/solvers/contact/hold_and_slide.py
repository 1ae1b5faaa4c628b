# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Keeping contact with an obstacle (paper, section 5.3, Fig. 15, 16).

Arc length, place and direction at the contact leave the force of contact free: a curve of gripper
poses and shapes (`inverse.solvers.contact.family`), whose admissible parts are intervals
(`inverse.solvers.contact.intervals`). A condition chooses from them, and the direct simulation
confirms what is chosen (`inverse.solvers.contact.touching`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.solvers.contact.intervals import best_first, minima
from dlo_planner.inverse.solvers.contact.touching import HARDLY_STABLE, ContactProblem
from dlo_planner.model.pose import Pose
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.continuity import gripper_motion
from dlo_planner.plan.plan import Plan

if TYPE_CHECKING:
    from dlo_planner.inverse.tasks.hold_contact import HoldContact
    from dlo_planner.inverse.tasks.slide_contact import SlideContact

CONDITIONS = ('least_energy', 'least_force', 'least_motion', 'largest_clearance')
_FORCE_ERROR = 1e-3   # relative: the last force that is confirmed
_TRIED = 8      # forces of an interval, before none of it counts as confirmed
_PACE = 0.12    # rad plus part of the length: of one step through a family
_NEAR = 0.06    # the same: a step that is no leap
_MOST_HALVINGS = 7
_BESIDE = (1.0, 0.9, 1.1, 0.75, 1.33)  # of a force: other shapes that may lead on


def hold_contact(simulator: DirectSimulator, task: HoldContact, start: Pose | None,
                 demands: PlanRequirements) -> Plan:
    """Return the Plan of a HoldContact task; see `InverseSimulator.hold_contact`."""
    s, forces, condition = task.s, task.forces, task.condition
    problem = ContactProblem.at(simulator, task.contact, s, demands, task.min_force)
    builder = PlanBuilder([simulator.rod.length - s], problem.demands)
    parts = problem.parts(forces, builder)
    if condition is not None:
        _, shape = _chosen(problem, parts, condition, start, builder)
        builder.add(problem.waypoint(shape))
        return builder.finished()
    if forces is None:
        calm = _minima_of(problem, parts, 'least_energy', None)[0][1]
        part = next(part for part in parts if part[0] <= calm <= part[-1])
        shapes = _motion(problem, part)
    else:
        confirmed = (problem.confirmed(force) for part in parts for force in part)
        shapes = [shape for shape in confirmed if shape is not None]
    if not shapes:
        raise problem.unconfirmed(builder, parts)
    builder = PlanBuilder([simulator.rod.length - s] * len(shapes), problem.demands)
    for shape in shapes:
        builder.add(problem.waypoint(shape))
    return builder.finished()


def slide_contact(simulator: DirectSimulator, task: SlideContact, start: Pose | None,
                  demands: PlanRequirements) -> Plan:
    """Return the Plan of an aligned SlideContact; see `InverseSimulator.slide_contact`."""
    lengths, forces, condition = task.lengths, task.forces, task.condition
    problem = ContactProblem.at(simulator, task.contact, lengths[0], demands, task.min_force)
    builder = PlanBuilder([simulator.rod.length - s for s in lengths], problem.demands)
    before = None
    for s in lengths:
        problem = problem.moved(s)
        parts = problem.parts(forces, builder)
        if before is None:
            force, shape = first_choice(problem, parts, condition, start, builder)
        else:
            force, shape = _continued(problem, parts, condition, before, builder)
        builder.add(problem.waypoint(shape))
        before = problem, force
    return builder.finished()


def _cost_of(problem: ContactProblem, condition: str,
             start: Pose | None) -> Callable[[float], float]:
    """Return the function of the force that a condition of CONDITIONS minimizes."""
    family = problem.family
    if condition == 'least_force':
        return lambda force: force
    if condition == 'least_motion' and start is not None:
        return lambda force: _away(family.shape(force), start)
    others = any(k != family.obstacle for k in range(len(problem.simulator.obstacles)))
    if condition == 'largest_clearance' and others:
        return lambda force: -family.gap(family.shape(force), others=True)
    return lambda force: family.shape(force).elastic_energy


def _minima_of(problem: ContactProblem, parts: list[list[float]], condition: str,
               start: Pose | None) -> list[tuple[float, float]]:
    """Return [(cost, force)], best first, of the local minima in all `parts`."""
    cost = _cost_of(problem, condition, start)
    return best_first([minimum for part in parts for minimum in minima(cost, problem.merit, part)])


def first_choice(problem: ContactProblem, parts: list[list[float]], condition: str,
                 start: Pose | None, builder: PlanBuilder) -> tuple[float, Shape]:
    """Return force and confirmed Shape with which a slide begins; raise Infeasible."""
    how = 'least_energy' if condition == 'least_motion' and start is None else condition
    return _chosen(problem, parts, how, start, builder)


def _chosen(problem: ContactProblem, parts: list[list[float]], condition: str, start: Pose | None,
            builder: PlanBuilder) -> tuple[float, Shape]:
    """Return force and confirmed Shape that a condition prefers; raise Infeasible."""
    cost, choices = _cost_of(problem, condition, start), []
    for _, force in _minima_of(problem, parts, condition, start):
        choice = _confirmed(problem, parts, force)
        if choice is not None:
            choices.append((cost(choice[0]), *choice))
            if choice[0] == force:
                break
    if not choices:
        raise problem.unconfirmed(builder, parts)
    return min(choices, key=lambda one: one[0])[1:]


def _confirmed(problem: ContactProblem, parts: list[list[float]],
               force: float) -> tuple[float, Shape] | None:
    """Return a force with its confirmed Shape, or the nearest confirmed pair, or None."""
    shape = problem.confirmed(force)
    if shape is not None:
        return force, shape
    part = next(part for part in parts if part[0] <= force <= part[-1])
    return _nearest_confirmed(problem, part, force)


def _nearest_confirmed(problem: ContactProblem, part: list[float],
                       force: float) -> tuple[float, Shape] | None:
    """Return the confirmed (force, Shape) nearest to an unconfirmed force, or None."""
    some = part[::max(1, len(part) // _TRIED)]
    for good in sorted(some, key=lambda one: abs(np.log(one / force))):
        shape = problem.confirmed(good)
        if shape is not None:
            break
    else:
        return None
    while abs(good - force) > _FORCE_ERROR * good:
        middle = float(np.sqrt(good * force))
        trial = problem.confirmed(middle) if problem.merit(middle) > 0 else None
        if trial is None:
            force = middle
        else:
            good, shape = middle, trial
    return good, shape


def _motion(problem: ContactProblem, part: list[float]) -> list[Shape]:
    """Return confirmed Shapes through an interval, ascending, each gripper near the one before."""
    family, most = problem.family, part[-1]
    forces = [part[0]]
    while forces[-1] < most:
        target = most
        while (_step(family.shape(forces[-1]), family.shape(target)) > _PACE
               and target - forces[-1] > 1e-6 * most):
            target = 0.5 * (target + forces[-1])
        forces.append(target)
    shapes = [problem.confirmed(force) for force in forces]
    stability = {k: shape.stability for k, shape in enumerate(shapes) if shape is not None}
    if not stability:
        return []
    first = last = max(stability, key=stability.__getitem__)
    while first - 1 in stability:
        first -= 1
    while last + 1 in stability:
        last += 1

    def end(inside: int, outside: int) -> list[Shape]:
        """Return [the confirmed Shape nearest to an unconfirmed one], [] if there is none."""
        if not 0 <= outside < len(shapes):
            return []
        nearest = _nearest_confirmed(problem, [forces[inside]], forces[outside])
        return [] if nearest is None else [nearest[1]]

    inside = [shape for shape in shapes[first:last + 1] if shape is not None]
    return [*end(first, first - 1), *inside, *end(last, last + 1)]


def _continued(problem: ContactProblem, parts: list[list[float]], condition: str,
               before: tuple[ContactProblem, float], builder: PlanBuilder) -> tuple[float, Shape]:
    """Return force and confirmed Shape that continue a (ContactProblem, force) `before`.

    It is the nearest of the local minima; the gripper must not leap to it.
    """
    last = builder.waypoints[-1].shape
    start = last.gripper
    candidates = _minima_of(problem, parts, condition, start)
    candidates.sort(key=lambda one: _away(problem.family.shape(one[1]), start))
    best: float | None = None
    for _, force in candidates:
        leap = _leap(before, (problem, force))
        if best is None or leap < best:
            best = leap
        if leap:
            continue
        confirmed = _confirmed(problem, parts, force)
        if confirmed is not None:
            return confirmed
    if not best:
        raise problem.unconfirmed(builder, parts)
    raise builder.refusal('continuity', best * last.s[-1], f'the gripper would leap by '
                          f'{best:.3g} (rad, and parts of the length) from the waypoint before, '
                          'however slowly the DLO is drawn')


def _leap(one: tuple[ContactProblem, float], other: tuple[ContactProblem, float],
          halvings: int = _MOST_HALVINGS) -> float:
    """Return 0 if admissible shapes lead from a (ContactProblem, force) to another.

    Else how far, in rad and parts of the length, the gripper leaps over what is not admissible.
    Arc length and logarithm of the force change about evenly.
    """
    (problem, force), (last, its) = one, other
    apart = _step(problem.family.shape(force), last.family.shape(its))
    if apart <= _NEAR and halvings < _MOST_HALVINGS:
        return 0.0
    if not halvings:
        return apart
    halfway = problem.moved(0.5 * (problem.s + last.s))
    halfway.family.stable = HARDLY_STABLE  # the shapes may be at the very end of an interval
    forces = (float(np.sqrt(force * its)) * part for part in _BESIDE)
    between = next((one for one in forces if halfway.family.merit(one) > 0), None)
    if between is None:
        return apart
    middle = (halfway, between)
    return _leap(one, middle, halvings - 1) or _leap(middle, other, halvings - 1)


def _step(one: Shape, other: Shape) -> float:
    """Return the gripper's motion between two Shapes, see `gripper_motion`."""
    return gripper_motion(one.gripper, other.gripper, one.s[-1])


def _away(shape: Shape, before: Pose) -> float:
    """Return the square of a motion from the Pose `before`, in parts of the length and a turn."""
    shift = (shape.gripper.position - before.position) / shape.s[-1]
    turn = 1 - 0.25 * (1 + np.trace(shape.gripper.rotation @ before.rotation.T))
    return float(shift @ shift + turn)
