# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Keeping contact with an obstacle (paper, section 5.3, Fig. 15, 16).

Arc length, place and direction at the contact leave the force of contact free: a curve of gripper
poses and shapes (`inverse.contact_branch`). A condition chooses from what is admissible of it, and
the direct simulation confirms what is chosen. A scan over the decades of the force finds where a
hold or a slide begins; a slide then follows the condition's minimum from one arc length to the
next.

On a straight slide (footnote 19) the gripper goes straight towards the contact, its orientation
kept. The one unknown is how far it has gone; it is found for each arc length that is to touch.
Place and direction of the contact follow from the direct simulation, and drift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.contact_branch import STABLE, ContactBranch
from dlo_planner.inverse.continuation import (
    BranchPoint,
    Follower,
    SolutionBranch,
    Step,
    continue_branch,
)
from dlo_planner.inverse.task import MOST, PlanContext, Task
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder, refusal_for_accuracy
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.continuity import apart, gripper_motion
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

CONDITIONS = ('least_energy', 'least_force', 'least_motion', 'largest_clearance')
LEAST_FORCE, MOST_FORCE = 1e-3, 30.0  # forces looked at, as parts of the natural ones
PRESSED = 0.1             # the same: the least one of a plan, where a task states none
_PER_DECADE = 8           # forces of a scan
_LOOKED_CLOSER = 4        # forces beside which an admissible one may hide
_CLOSE = 1e-5             # relative: how well a force is found
_ALIKE = 1e-9             # relative: costs that differ by less are alike
_WORST = 1e6              # stands for no value at all
_ELEMENTS = 64            # of the mesh on which a force is chosen
_MOST_ELEMENTS = 4096
HARDLY_STABLE = 1e-3      # what counts as stable where nothing is more stable
_SAME_FORCE, _SAME_PLACE = 0.1, 1e-3  # relative; of the length: what counts as confirmed
_NEAR = 0.02              # of the length: contacts that are counted as the one
_FORCE_ERROR = 1e-3       # relative: the last force that is confirmed
_BESIDE = (1.03, 0.97, 1.3, 0.77, 2.0, 0.5, 4.0, 8.0, 20.0, 60.0)  # of a force: others to confirm
_PACE = 0.12              # rad plus part of the length: of one step through all forces
_SPAN, _SPANS = 1.3, 8    # from one force to the next of a slide, at most: the ratio, and its power

Cost: TypeAlias = Callable[[float], float]  # of a force, N


@dataclass(frozen=True)
class ContactProblem:
    """One contact task at one arc length: the forces that keep all demands."""

    simulator: DirectSimulator
    branch: ContactBranch  # a quick one, on a coarse mesh
    contact: Pose  # on the obstacle's surface: x axis along the DLO, z axis outwards
    demands: PlanChecker  # what the plan has to keep, the least force of the contact among it
    forces: Floats | None = None  # (n,) the only ones, N; None: all

    @classmethod
    def at(cls, simulator: DirectSimulator, task: HoldContact | SlideContact, s: float,
           demands: PlanChecker) -> Self:
        """Return the problem of a task at the arc length `s`, m."""
        branch = _branch(simulator, task.contact, s, demands)
        least = PRESSED * branch.scale[0] if task.min_force is None else task.min_force
        return cls(simulator, branch, task.contact,
                   replace(demands, min_force=least, pressed=branch.obstacle), task.forces)

    def moved(self, s: float) -> Self:
        """Return the same problem at another arc length, m."""
        return replace(self, branch=_branch(self.simulator, self.contact, s, self.demands))

    @property
    def s(self) -> float:
        """Arc length of the contact, m."""
        return self.branch.s

    def merit(self, force: float) -> float:
        """Return a number that is positive if this force keeps all demands."""
        merit = self.branch.merit(force)
        if merit <= 0:
            return merit
        broken = self.demands.violation(self.waypoint(self.branch.shape(force)))
        return merit if broken is None else broken.room

    def waypoint(self, shape: Shape) -> Waypoint:
        """Return the Waypoint of a Shape."""
        return waypoint_at(shape, self.branch.place, self.s, self.branch.frame[:, 0])

    def force_of(self, shape: Shape, s: float) -> float:
        """Return the force of the contact of a Shape at the arc length `s` in m, N."""
        return float(sum(one.force for one in shape.contacts
                         if one.obstacle == self.branch.obstacle
                         and abs(one.s - s) < _NEAR * shape.s[-1]))

    def cost(self, condition: str, start: Pose | None) -> Cost:
        """Return the function of the force that a condition of CONDITIONS minimizes."""
        branch = self.branch
        if condition == 'least_force':
            return lambda force: force
        if condition == 'least_motion' and start is not None:
            length = self.simulator.rod.length
            return lambda force: _away(branch.hanging(force)[1], start, length)
        others = any(k != branch.obstacle for k in range(len(self.simulator.obstacles)))
        if condition == 'largest_clearance' and others:
            return lambda force: -branch.gap(branch.shape(force), others=True)
        return branch.elastic_energy

    def minima(self, cost: Cost) -> list[tuple[float, float]]:
        """Return [(cost, force)] of the local minima among admissible forces, best first."""
        branch, found = self.branch, list[tuple[float, float]]()
        for _ in range(2):
            found = self._minima(cost)
            best = branch.most_stable()
            if found or best is None or not HARDLY_STABLE < best.stability <= STABLE:
                break
            branch.stable = 0.5 * best.stability
        unit = _ALIKE * max((abs(one) for one, _ in found), default=0.0) or 1.0
        return sorted(found, key=lambda one: (round(one[0] / unit), one[1]))

    def _minima(self, cost: Cost) -> list[tuple[float, float]]:
        if self.forces is not None:
            return [(cost(one), one) for one in self.forces.tolist() if self.merit(one) > 0]
        least, most = LEAST_FORCE * self.branch.scale[0], MOST_FORCE * self.branch.scale[1]
        number = int(np.ceil(_PER_DECADE * np.log10(most / least))) + 2
        forces = np.geomspace(least, most, number).tolist()
        merits = [self.merit(force) for force in forces]
        if max(merits) <= 0:
            forces, merits = self._with_hidden(forces, merits)
        costs = [cost(force) if merit > 0 else np.inf for force, merit in zip(
            forces, merits, strict=True)]
        ends = [forces[0], *forces, forces[-1]]
        return [(cost(least), least) for k, one in enumerate(costs)
                if np.isfinite(one) and one <= min(costs[max(k - 1, 0):k + 2])
                for least in [self.least(cost, ends[k], forces[k], ends[k + 2])]]

    def _with_hidden(self, forces: list[float],
                     merits: list[float]) -> tuple[list[float], list[float]]:
        """Return forces and merits with those between that may be admissible, though none is."""
        tops = [k for k in range(1, len(forces) - 1)
                if merits[k] >= max(merits[k - 1], merits[k + 1]) > -np.inf]
        more = dict(zip(forces, merits, strict=True))
        for k in sorted(tops, key=lambda k: -merits[k])[:_LOOKED_CLOSER]:
            best = minimize_scalar(
                lambda log: -max(self.merit(float(np.exp(log))), -_WORST), method='bounded',
                bounds=np.log([forces[k - 1], forces[k + 1]]), options={'maxiter': 20})
            more[float(np.exp(best.x))] = -float(best.fun)
        return sorted(more), [more[force] for force in sorted(more)]

    def least(self, cost: Cost, low: float, force: float, high: float) -> float:
        """Return the admissible force between two where the cost is least, near an admissible one.

        What is not admissible costs the more, the farther it is from `force`.
        """
        begin, worst = float(np.log(force)), abs(cost(force)) + _WORST

        def judged(log: float) -> float:
            x = float(np.exp(log))
            return cost(x) if self.merit(x) > 0 else worst * (1 + abs(log - begin))

        def found(function: Cost) -> float:
            return float(np.exp(minimize_scalar(function, method='bounded', bounds=np.log(
                [low, high]), options={'xatol': _CLOSE}).x))

        best = found(lambda log: cost(float(np.exp(log))))  # which costs less than a judgement
        if not self.merit(best) > 0:
            best = found(judged)
        return best if self.merit(best) > 0 and cost(best) < cost(force) else force

    def confirmed(self, force: float, rolling: bool = False) -> Shape | None:
        """Return the Shape if the direct simulator finds it with this force, else None.

        With an accuracy it begins on the mesh of the family, where the contact is at a node and
        cannot roll: that makes it less stable. If `rolling`, no node is there.
        """
        guess = self._guess(force)
        if rolling:
            place, elements = self.s / guess.s[-1], guess.s.size - 1
            guess = guess.resample(min((elements, elements + 1),
                                       key=lambda count: abs(count * place % 1 - 0.5)))
        shape = self._reached(guess)
        off = np.linalg.norm(shape.frame_at(self.s)[1] - self.branch.place)
        same = (abs(self.force_of(shape, self.s) - force) <= _SAME_FORCE * force
                and off <= _SAME_PLACE * shape.s[-1])
        kept = shape.converged and same and self.demands.violation(self.waypoint(shape)) is None
        return shape if kept else None

    def _reached(self, guess: Shape) -> Shape:
        """Return the Shape that the direct simulator finds near one on another mesh.

        First as if nothing rubbed: friction would hold what the other mesh is off by.
        """
        if any(one.friction for one in self.simulator.obstacles):
            guess = self.simulator.with_friction(0.0).solve(guess.gripper, guess)
        return self.simulator.solve(guess.gripper, guess)

    def nearest_confirmed(self, force: float) -> tuple[float, Shape] | None:
        """Return the admissible force nearest to one that is confirmed, with its Shape, or None."""
        shape, good = self.confirmed(force), force
        if shape is not None or self.forces is not None:
            return None if shape is None else (force, shape)
        for part in _BESIDE:
            good = part * force
            shape = self._admissible(good)
            if shape is not None:
                break
        while shape is not None and abs(good - force) > _FORCE_ERROR * good:
            middle = float(np.sqrt(good * force))
            trial = self._admissible(middle)
            if trial is None:
                force = middle
            else:
                good, shape = middle, trial
        if shape is None and self.simulator.accuracy is not None:
            shape, good = self.confirmed(force, rolling=True), force
        return None if shape is None else (good, shape)

    def _admissible(self, force: float) -> Shape | None:
        return self.confirmed(force) if self.merit(force) > 0 else None

    def motion(self, force: float) -> list[Shape]:
        """Return confirmed Shapes, each gripper near the one before, by all forces about one."""
        found = self.nearest_confirmed(force)
        if found is None:
            return []
        ways = []
        for end in (LEAST_FORCE * self.branch.scale[0], MOST_FORCE * self.branch.scale[1]):
            (at, shape), way, target = found, list[Shape](), end
            while abs(np.log(target / at)) > _FORCE_ERROR:
                near = abs(np.log(target / at)) < np.log(10) / _PER_DECADE  # no gap between
                other = self._admissible(target) if near and gripper_motion(
                    shape.gripper, self.branch.hanging(target)[1], shape.s[-1]) <= _PACE else None
                if other is None:
                    target = float(np.sqrt(at * target))
                else:
                    way.append(other)
                    at, shape, target = target, other, end
            ways.append(way)
        return [*ways[0][::-1], found[1], *ways[1]]

    def _guess(self, force: float) -> Shape:
        """Return the Shape with this force on a mesh as fine as the simulator's."""
        own, accuracy = self.simulator.mesh, self.simulator.accuracy
        shape = self.branch.shape(force)
        elements = shape.s.size - 1
        finer_elements = own.s.size - 1
        samples = np.linspace(0, shape.s[-1], 9)
        while True:
            if accuracy is not None:
                finer_elements = min(2 * elements, _MOST_ELEMENTS)
            if finer_elements == elements:
                return shape
            branch = ContactBranch(self.simulator, self.contact, self.s,
                                   self.demands.progress.check, finer_elements)
            finer = branch.shape(force)
            moved = np.abs(finer.positions_at(samples) - shape.positions_at(samples)).max()
            shape, elements = finer, finer_elements
            if accuracy is not None and moved < 0.2 * accuracy:
                return shape

    def refusal(self, builder: PlanBuilder) -> Infeasible:
        """Return Infeasible, with the reason against the best of the examined shapes."""
        branch = self.branch
        good = [force for force in branch.known if branch.merit(force) > 0]
        if good:
            broken = (self.demands.violation(self.waypoint(branch.shape(force)))
                      for force in good)
            best = max((one for one in broken if one is not None), key=lambda one: one.room)
            return builder.refusal(best.name, -best.room, f'none of {len(good)} contact forces is '
                                   f'admissible; with the best of them, {best.message}', best.unit)
        looked = (f'no contact force of {min(branch.known):.3g} to {max(branch.known):.3g} N keeps '
                  f'the DLO touching at s = {self.s:g} m')
        stable = branch.most_stable()
        if stable is None:
            least = min(branch.shape(force).violation for force in branch.known)
            return builder.refusal('contact', least, f'{looked}: with each of them it would be in '
                                   f'an obstacle, by {least:.3g} m at least')
        return builder.refusal(
            'contact', branch.stable - stable.stability, f'{looked} in a stable shape: the best '
            f'one has a stability of {stable.stability:.3g}, at least {branch.stable:.3g} is '
            'required', '')

    def unconfirmed(self, builder: PlanBuilder) -> Infeasible:
        """Return Infeasible because the direct simulation confirms no admissible force."""
        best = max((shape for force, shape in self.branch.known.items() if self.merit(force) > 0),
                   key=lambda shape: shape.stability)
        reached = self._reached(best)
        inexact = refusal_for_accuracy(self.simulator, builder, reached)
        if inexact is not None:
            return inexact
        off, broken = apart(reached, best), self.demands.violation(self.waypoint(reached))
        why = ('the direct simulation with its own discretization confirms none of the admissible '
               'contact forces; a finer one may; the DLO would be ')
        if off > _SAME_PLACE * reached.s[-1] or broken is None:
            return builder.refusal('contact', off, f'{why}off by {off:.3g} m')
        return builder.refusal(broken.name, -broken.room, f'{why}there, but: {broken.message}',
                               broken.unit)


def _branch(simulator: DirectSimulator, contact: Pose, s: float,
            demands: PlanChecker) -> ContactBranch:
    elements = min(max(simulator.mesh.s.size - 1, 8), 2 * _ELEMENTS)
    return ContactBranch(simulator, contact, s, demands.progress.check, elements)


def _chosen(problem: ContactProblem, condition: str, start: Pose | None,
            builder: PlanBuilder) -> Shape:
    """Return the confirmed Shape that a condition prefers; raise Infeasible."""
    cost, choices = problem.cost(condition, start), list[tuple[float, Shape]]()
    minima = problem.minima(cost)
    for _, force in minima:
        choice = problem.nearest_confirmed(force)
        if choice is not None:
            choices.append((cost(choice[0]), choice[1]))
            if choice[0] == force:
                break
    if not choices:
        raise problem.unconfirmed(builder) if minima else problem.refusal(builder)
    return min(choices, key=lambda one: one[0])[1]


def _away(gripper: Pose, before: Pose, length: float) -> float:
    """Return the square of a motion between two Poses, in parts of the length and a turn."""
    shift = (gripper.position - before.position) / length
    turn = 1 - 0.25 * (1 + np.trace(gripper.rotation @ before.rotation.T))
    return float(shift @ shift + turn)


class AlignedSlide(SolutionBranch):
    """The shapes that touch at s = L - depth; a condition chooses the force."""

    what = 'that touch there'

    def __init__(self, problem: ContactProblem, condition: str) -> None:
        self.simulator, self.problem, self.condition = problem.simulator, problem, condition

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at the condition's minimum over the force, nearest to `before`."""
        del roll
        if depth == before.depth:
            return before
        problem = self.problem.moved(self.simulator.rod.length - depth)
        problem.branch.stable = float(np.clip(0.5 * before.shape.stability, HARDLY_STABLE, STABLE))
        force = self._force(problem, before)
        if force is None:
            return None
        if not final:
            return BranchPoint(problem.branch.shape(force), depth=depth).after(before)
        found = problem.nearest_confirmed(force)
        return found and BranchPoint(found[1], depth=depth).after(before)

    def _force(self, problem: ContactProblem, before: BranchPoint) -> float | None:
        last, cost = before.shape.gripper, problem.cost(self.condition, before.shape.gripper)
        if problem.forces is not None:
            good = (force for force in problem.forces.tolist() if problem.merit(force) > 0)
            return min(good, key=problem.cost('least_motion', last), default=None)
        floor = max(problem.demands.min_force, LEAST_FORCE * problem.branch.scale[0])
        force = max(problem.force_of(before.shape, self.simulator.rod.length - before.depth), floor)
        if not problem.merit(force) > 0:
            force = next((one for one in (part * force for part in _BESIDE)
                          if problem.merit(one) > 0), 0.0)
        for _ in range(_SPANS if force else 0):
            low, high = max(force / _SPAN, floor), force * _SPAN
            best = problem.least(cost, low, force, high)
            if low * (1 + _FORCE_ERROR) < best < high / (1 + _FORCE_ERROR) or best == force:
                return best
            force = best
        return force or None

    def replayed(self, last: Shape | None, point: BranchPoint) -> BranchPoint:
        """Return the BranchPoint: the direct simulation has confirmed it."""
        return point

    def waypoint(self, point: BranchPoint) -> Waypoint:
        """Return the Waypoint of a BranchPoint."""
        branch = self.problem.branch
        return waypoint_at(point.shape, branch.place,
                           self.simulator.rod.length - point.depth, branch.frame[:, 0])

    def refusal(self, builder: PlanBuilder, before: BranchPoint | None,
                step: Step) -> Infeasible | None:
        """Return why a Step does not lead on: no force is admissible, or the gripper would jump."""
        if step.point is not None:
            return None
        problem = self.problem.moved(self.simulator.rod.length - builder.depth)
        minima = problem.minima(problem.cost('least_force', None))
        if not minima:
            return problem.refusal(builder)
        if not any(problem.nearest_confirmed(force) for _, force in minima):
            return problem.unconfirmed(builder)
        last = builder.waypoints[-1].shape.gripper
        length = self.simulator.rod.length
        jump = length * min(gripper_motion(last, problem.branch.hanging(force)[1], length)
                            for _, force in minima)
        return builder.refusal('continuity', jump, 'the gripper would have to jump by '
                               f'{jump:.3g} m (a '
                               'turn counts as the motion of a point at the DLO\'s length from it) '
                               'from the waypoint before, however slowly the DLO is drawn')


_ARC_ERROR = 1e-6     # of the length: how exactly an arc length touches
_HOP = 5e-3       # of the length: so far a contact may hop where it passes a node
_TRIALS = 60
_SAME = 1e-10     # of the way: places that are one
_FALL = 1e-5      # of the way: near a fall the place that touches goes with its root


class _Trial(NamedTuple):
    """A place of the gripper that was tried."""

    gone: float  # part of the straight way
    # arc length that is left to the one wanted, m: positive before it, negative beyond it; nan
    # where the DLO does not follow or does not touch
    left: float
    shape: Shape


class StraightSlide(AlignedSlide):
    """The shapes that touch at s = L - depth, the gripper straight on the way to the contact."""

    what = 'that touch on the straight way'
    longest = shortest = 0.03
    soft = True

    def __init__(self, problem: ContactProblem, first: Pose) -> None:
        super().__init__(problem, 'least_motion')
        self._first, self._way = first, problem.branch.place - first.position
        self._ended: tuple[str, float, str] | None = None  # why the last search found nothing

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint that touches at L - depth.

        The nearer the gripper is, the less of the DLO is left: a root is bracketed and found. All
        trials go on from the Shape before: friction remembers.
        """
        del roll, final
        if depth == before.depth:
            return before
        length = self.simulator.rod.length
        target, gone = length - depth, self._gone(before.shape)
        touching = self._touches_at(before.shape, target)
        sign = np.sign(touching - target)
        near = _Trial(gone, float(abs(touching - target)), before.shape)
        far: _Trial | None = None
        trial = self._guess(before, gone, touching, target)
        for _ in range(_TRIALS if near.left > _ARC_ERROR * length else 0):
            self.problem.demands.progress.check()
            # a fall costs the less, the shorter the way to it
            falls = far is not None and np.isnan(far.left)
            shape = self._at(trial, near.shape if falls else before.shape)
            left = sign * (self._touches_at(shape, target) - target)
            tested = _Trial(trial, left if shape.converged and not shape.jumped else np.nan, shape)
            if abs(tested.left) <= _ARC_ERROR * length:
                return BranchPoint(shape, depth=depth).after(before)
            if tested.left > 0:
                near, before_that = tested, near
            else:
                far, before_that = tested, near
            trial = _next(near, far, before_that)
            if far is not None and abs(far.gone - near.gone) < (
                    _FALL if np.isnan(far.left) else _SAME):
                break
        return self._hopped(near, far, target, before)

    def waypoint(self, point: BranchPoint) -> Waypoint:
        """Return the Waypoint of a BranchPoint, where it touches."""
        branch, s = self.problem.branch, self.simulator.rod.length - point.depth
        return waypoint_at(point.shape, branch.place, self._touches_at(point.shape, s),
                           branch.frame[:, 0])

    def refusal(self, builder: PlanBuilder, before: BranchPoint | None,
                step: Step) -> Infeasible | None:
        """Return why a Step does not lead on: the DLO falls, or does not come to touch."""
        if step.point is not None:
            return None
        assert self._ended is not None  # else there is one
        return builder.refusal(*self._ended)

    def _gone(self, shape: Shape) -> float:
        """Return the part of the way that the gripper of a Shape has gone."""
        return float((shape.gripper.position - self._first.position) @ self._way
                     / (self._way @ self._way))

    def _touches_at(self, shape: Shape, s: float) -> float:
        """Return the arc length in m, nearest to `s`, at which a Shape touches; nan: nowhere."""
        touching = [one.s for one in shape.contacts
                    if one.obstacle == self.problem.branch.obstacle]
        return float(min(touching, key=lambda one: abs(one - s), default=np.nan))

    def _at(self, gone: float, before: Shape) -> Shape:
        """Return the Shape that follows the Shape `before` when the gripper has `gone` so far."""
        gripper = Pose.from_rotation(self._first.position + gone * self._way, self._first.rotation)
        return self.simulator.track([gripper], initial=before)[0]

    def _guess(self, before: BranchPoint, gone: float, touching: float, target: float) -> float:
        """Return about how far the gripper has to go: as in the step before, if there is one."""
        if before.since is not None:
            was = self._touches_at(before.since.shape, touching)
            share = (target - touching) / (touching - was) if touching != was else 0.0
            if 0.0 < share < 4.0:
                return gone + share * (gone - self._gone(before.since.shape))
        return 1 - (1 - gone) * target / touching

    def _hopped(self, near: _Trial, far: _Trial | None, target: float,
                before: BranchPoint) -> BranchPoint | None:
        """Return the BranchPoint of the trial nearest to `target`, None if that is too far."""
        known = [one for one in (near, far) if one is not None and not np.isnan(one.left)]
        _, left, shape = min(known, key=lambda one: abs(one.left))
        length = self.simulator.rod.length
        if abs(left) <= _HOP * length:  # from one side of a node to the other
            return BranchPoint(shape, depth=length - target).after(before)
        if far is not None and np.isnan(far.left) and (
                far.shape.jumped or not np.isnan(self._touches_at(far.shape, target))):
            self._ended = ('continuity', apart(far.shape, near.shape), 'the DLO would fall '
                           f'into another shape before it touches at s = {target:.4g} m')
        else:
            self._ended = ('contact', abs(left), 'the DLO does not come to touch at s = '
                           f'{target:.4g} m on the straight way, at best {abs(left):.3g} m off')
        return None


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


@dataclass(frozen=True, eq=False, repr=False)
class HoldContact(Task):
    """Hold one contact; `InverseSimulator.hold_contact` says what the attributes mean.

    Attributes
    ----------
    contact : Pose
        Pose on the surface of an obstacle: x axis along the DLO, z axis outwards.
    s : float
        Arc length of the contact, m.
    condition : str or None
        'least_energy', 'least_force', 'least_motion', 'largest_clearance'. If None, all.
    forces : ndarray, shape (n,) or None
        Forces in N: only these are examined. If None, all.
    min_force : float or None
        Least force of the contact, N. If None, a tenth of weight + EI / L^2.
    """

    touches: ClassVar[bool] = True
    hangs_after: ClassVar[bool] = False

    contact: Pose
    s: float
    condition: str | None = 'least_energy'
    forces: Floats | None = None
    min_force: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, contact: Pose, s: float, condition: str | None = 'least_energy',
                     forces: ArrayLike | None = None, min_force: float | None = None
                     ) -> None: ...

    def __post_init__(self) -> None:
        put(self, s=number('s', self.s, above=0), forces=checked_forces(self.forces),
            min_force=checked_least(self.min_force))
        instance('contact', self.contact, Pose)
        if self.condition is not None:
            choice('condition', self.condition, CONDITIONS)
        super().__post_init__()

    @property
    def outwards(self) -> Floats:
        """(3,) away from the obstacle."""
        away: Floats = self.contact.rotation[:, 2]
        return away

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        number('s', self.s, above=0, below=context.rod.length)
        check_obstacles(context)
        if self.condition == 'least_motion' and context.start is None:
            raise InvalidTask('start = None: expected a Pose with condition \'least_motion\'')
        problem = ContactProblem.at(context.simulator, self, self.s, context.demands)
        depth = context.rod.length - self.s
        builder = PlanBuilder([depth], problem.demands)
        if self.condition is not None:
            shapes = [_chosen(problem, self.condition, context.start, builder)]
        else:
            minima = problem.minima(problem.cost('least_energy', None))
            if not minima:
                raise problem.refusal(builder)
            shapes = problem.motion(minima[0][1]) if self.forces is None else [
                shape for _, force in sorted(minima, key=lambda one: one[1])
                for shape in [problem.confirmed(force)] if shape is not None]
            if not shapes:
                raise problem.unconfirmed(builder)
        builder = PlanBuilder([depth] * len(shapes), problem.demands)
        for shape in shapes:
            builder.add(problem.waypoint(shape))
        return builder.finished()


def checked_forces(forces: object) -> Floats | None:
    """Return the forces (n,) to be examined, N, or None (all)."""
    return None if forces is None else row('forces', forces, most=MOST, above=0)


def checked_least(force: object) -> float | None:
    """Return the least force of a contact, N, or None (of the DLO's own scale)."""
    return None if force is None else number('min_force', force, minimum=0)


def check_obstacles(context: PlanContext) -> None:
    """Raise InvalidTask if the simulator has no obstacle to touch."""
    if not context.simulator.obstacles:
        raise InvalidTask('simulator has no obstacles: expected the one to touch among them')


@dataclass(frozen=True, eq=False, repr=False)
class SlideContact(Task):
    """Slide along one contact; `InverseSimulator.slide_contact` says what the attributes mean.

    Attributes
    ----------
    contact : Pose
        Pose on the surface of an obstacle: x axis along the DLO, z axis outwards.
    lengths : ndarray, shape (n,)
        Arc lengths between gripper and contact, m, one after the other.
    condition : str
        'least_energy', 'least_force', 'least_motion', 'largest_clearance'.
    forces : ndarray, shape (n,) or None
        Forces in N: only these are examined. If None, all.
    mode : str
        'aligned' or 'straight'.
    min_force : float or None
        Least force of the contact, N. If None, a tenth of weight + EI / L^2.
    """

    touches: ClassVar[bool] = True
    hangs_after: ClassVar[bool] = False

    contact: Pose
    lengths: Floats
    condition: str = 'least_motion'
    forces: Floats | None = None
    mode: str = 'aligned'
    min_force: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, contact: Pose, lengths: ArrayLike, condition: str = 'least_motion',
                     forces: ArrayLike | None = None, mode: str = 'aligned',
                     min_force: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, lengths=row('lengths', self.lengths, most=MOST, above=0),
            forces=checked_forces(self.forces), min_force=checked_least(self.min_force))
        choice('condition', self.condition, CONDITIONS)
        choice('mode', self.mode, ('aligned', 'straight'))
        instance('contact', self.contact, Pose)
        super().__post_init__()

    @property
    def outwards(self) -> Floats:
        """(3,) away from the obstacle."""
        away: Floats = self.contact.rotation[:, 2]
        return away

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        row('lengths', self.lengths, most=MOST, above=0, below=context.rod.length)
        check_obstacles(context)
        problem = ContactProblem.at(context.simulator, self, self.lengths[0], context.demands)
        depths, least = context.rod.length - self.lengths, self.condition == 'least_motion'
        builder = PlanBuilder(depths, problem.demands)
        first = _chosen(problem, 'least_energy' if least and context.start is None
                        else self.condition, context.start, builder)
        branch = (StraightSlide(problem, first.gripper) if self.mode == 'straight' else
                  AlignedSlide(problem, self.condition))
        begin = BranchPoint(first, depth=depths[0])
        continue_branch(builder, Follower(branch, begin, depths[0], depths), branch.waypoint)
        return builder.finished()
