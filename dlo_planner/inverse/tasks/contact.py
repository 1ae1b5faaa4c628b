# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Keeping contact with an obstacle (paper, section 5.3, Fig. 15, 16).

Arc length, place and direction at the contact leave the force of contact free: a curve of gripper
poses and shapes (`inverse.contact_family`), whose admissible parts are intervals. A condition
chooses from them, and the direct simulation confirms what is chosen.

On a straight slide (footnote 19) the gripper goes straight towards the contact, its orientation
kept. The one unknown is how far it has gone; it is found for each arc length that is to touch.
Place and direction of the contact follow from the direct simulation, and drift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.step import step
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.contact_family import STABLE, ContactFamily, best_first, intervals, minima
from dlo_planner.inverse.task import MOST, PlanContext, Task
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import Judge
from dlo_planner.plan.continuity import apart, gripper_motion
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

LEAST_FORCE, MOST_FORCE = 1e-3, 30.0  # forces looked at, as parts of the natural ones
PRESSED = 0.1             # the same: the least one of a plan, where a task states none
_ELEMENTS = 64            # of the mesh on which a force is chosen
_MOST_ELEMENTS = 4096
HARDLY_STABLE = 1e-3     # what counts as stable where nothing is more stable
_SAME_FORCE, _SAME_PLACE = 0.1, 1e-3  # relative; of the length: what counts as confirmed
_NEAR = 0.02              # of the length: contacts that are counted as the one


@dataclass(frozen=True)
class ContactProblem:
    """One contact task at one arc length."""

    simulator: DirectSimulator
    family: ContactFamily  # a quick one, on a coarse mesh
    contact: Pose  # on the obstacle's surface: x axis along the DLO, z axis outwards
    demands: Judge  # what the plan has to keep, the least force of the contact among it

    @classmethod
    def at(cls, simulator: DirectSimulator, contact: Pose, s: float,
           demands: Judge, min_force: float | None = None) -> Self:
        """Return the problem of keeping `contact` at the arc length `s`, m."""
        family = _family(simulator, contact, s, demands)
        least = PRESSED * family.scale[0] if min_force is None else min_force
        return cls(simulator, family, contact,
                   replace(demands, min_force=least, pressed=family.obstacle))

    def moved(self, s: float) -> Self:
        """Return the same problem at another arc length, m."""
        return replace(self, family=_family(self.simulator, self.contact, s, self.demands))

    @property
    def s(self) -> float:
        """Arc length of the contact, m."""
        return self.family.s

    def merit(self, force: float) -> float:
        """Return a number that is positive if this force keeps all demands."""
        merit = self.family.merit(force)
        if merit <= 0:
            return merit
        broken = self.demands.violation(self.waypoint(self.family.shape(force)))
        return merit if broken is None else -broken[1]

    def waypoint(self, shape: Shape) -> Waypoint:
        """Return the Waypoint of a Shape."""
        return waypoint_at(shape, self.family.place, self.s, self.family.frame[:, 0])

    def parts(self, forces: Floats | None, builder: PlanBuilder) -> list[list[float]]:
        """Return the admissible intervals as lists of forces, ascending; raise Infeasible if none.

        Shapes: forces (n,).
        """
        family = self.family
        for _ in range(2):
            if forces is not None:
                admissible = [[float(force)] for force in forces if self.merit(float(force)) > 0]
            else:
                least, most = LEAST_FORCE * family.scale[0], MOST_FORCE * family.scale[1]
                admissible = intervals(self.merit, least, most)
            best = family.most_stable()
            if admissible or best is None or not HARDLY_STABLE < best.stability <= STABLE:
                break
            family.stable = 0.5 * best.stability
        if not admissible:
            raise self._refusal(builder)
        return admissible

    def confirmed(self, force: float) -> Shape | None:
        """Return the Shape if the direct simulator finds it with this force, else None."""
        guess = self._guess(force)
        shape = self.simulator.solve(guess.gripper, guess)
        length = shape.s[-1]
        reached = sum(one.force for one in shape.contacts if one.obstacle == self.family.obstacle
                      and abs(one.s - self.s) < _NEAR * length)
        off = np.linalg.norm(shape.frame_at(self.s)[1] - self.family.place)
        same = abs(reached - force) <= _SAME_FORCE * force and off <= _SAME_PLACE * length
        kept = shape.converged and same and self.demands.violation(self.waypoint(shape)) is None
        return shape if kept else None

    def _guess(self, force: float) -> Shape:
        """Return the Shape with this force on a mesh as fine as the simulator's."""
        own, accuracy = self.simulator.mesh, self.simulator.accuracy
        shape = self.family.shape(force)
        elements = shape.s.size - 1
        finer_elements = own.s.size - 1
        samples = np.linspace(0, shape.s[-1], 9)
        while True:
            if accuracy is not None:
                finer_elements = min(2 * elements, _MOST_ELEMENTS)
            if finer_elements == elements:
                return shape
            family = ContactFamily(self.simulator, self.contact, self.s,
                                   self.demands.progress.check, finer_elements)
            finer = family.shape(force)
            moved = np.abs(finer.positions_at(samples) - shape.positions_at(samples)).max()
            shape, elements = finer, finer_elements
            if accuracy is not None and moved < 0.2 * accuracy:
                return shape

    def _refusal(self, builder: PlanBuilder) -> Infeasible:
        """Return Infeasible, with the reason against the best of the examined shapes."""
        family = self.family
        good = [force for force in family.known if family.merit(force) > 0]
        if good:
            violations = (self.demands.violation(self.waypoint(family.shape(force)))
                          for force in good)
            constraint, amount, why = min((one for one in violations if one is not None),
                                          key=lambda one: one[1])
            return builder.refusal(constraint, amount, f'none of {len(good)} contact forces is '
                                   f'admissible; with the best of them, {why}')
        looked = (f'no contact force of {min(family.known):.3g} to {max(family.known):.3g} N keeps '
                  f'the DLO touching at s = {self.s:g} m')
        best = family.most_stable()
        if best is None:
            least = min(family.shape(force).violation for force in family.known)
            return builder.refusal('contact', least, f'{looked}: with each of them it would be in '
                                   f'an obstacle, by {least:.3g} m at least')
        settled, _ = step(best.state.made_on, best.gripper, best)
        return self.left(builder, best, settled, f'{looked} in a stable shape: the best one has a '
                         f'stability of {best.stability:.3g}')

    def unconfirmed(self, builder: PlanBuilder, parts: list[list[float]]) -> Infeasible:
        """Return Infeasible because the direct simulation confirms no force of these intervals."""
        best = max((self.family.shape(force) for part in parts for force in part),
                   key=lambda shape: shape.stability)
        return self.left(builder, best, self.simulator.solve(best.gripper, best),
                         'the direct simulation with its own discretization confirms none of the '
                         'admissible contact forces; a finer one may')

    def left(self, builder: PlanBuilder, shape: Shape, reached: Shape, why: str) -> Infeasible:
        """Return Infeasible because the DLO is `reached` elsewhere; the amount is how far, in m."""
        amount = apart(reached, shape)
        return builder.refusal('contact', amount, f'{why}; the DLO would be off by {amount:.3g} m')


def _family(simulator: DirectSimulator, contact: Pose, s: float,
            demands: Judge) -> ContactFamily:
    elements = min(max(simulator.mesh.s.size - 1, 8), 2 * _ELEMENTS)
    return ContactFamily(simulator, contact, s, demands.progress.check, elements)


CONDITIONS = ('least_energy', 'least_force', 'least_motion', 'largest_clearance')
_FORCE_ERROR = 1e-3   # relative: the last force that is confirmed
_TRIED = 8      # forces of an interval, before none of it counts as confirmed
_PACE = 0.12    # rad plus part of the length: of one step through a family
_NO_LEAP = 0.06    # the same: a step that is no leap
_MOST_HALVINGS = 7
_BESIDE = (1.0, 0.9, 1.1, 0.75, 1.33)  # of a force: other shapes that may lead on


def hold_contact(simulator: DirectSimulator, task: HoldContact, start: Pose | None,
                 demands: Judge) -> Plan:
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
                  demands: Judge) -> Plan:
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
    if apart <= _NO_LEAP and halvings < _MOST_HALVINGS:
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


_ARC_ERROR = 1e-6     # of the length: how exactly an arc length touches
_HOP = 5e-3       # of the length: so far a contact may hop where it passes a node
_TRIALS = 60
_LONGEST = 0.03   # of the length: a step of the arc length that touches
_SAME = 1e-10     # of the way: places that are one


def slide_straight(simulator: DirectSimulator, task: SlideContact, start: Pose | None,
                   demands: Judge) -> Plan:
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
    """A place of the gripper that was tried."""

    gone: float  # part of the straight way
    # arc length that is left to the one wanted, m: positive before it, negative beyond it; nan
    # where the DLO does not follow or does not touch
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

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        number('s', self.s, above=0, below=context.rod.length)
        check_obstacles(context)
        if self.condition == 'least_motion' and context.start is None:
            raise InvalidTask('start = None: expected a Pose with condition \'least_motion\'')
        return hold_contact(context.simulator, self, context.start, context.demands)


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


_MODES = {'aligned': slide_contact, 'straight': slide_straight}


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
        choice('mode', self.mode, tuple(_MODES))
        instance('contact', self.contact, Pose)
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        row('lengths', self.lengths, most=MOST, above=0, below=context.rod.length)
        check_obstacles(context)
        return _MODES[self.mode](context.simulator, self, context.start, context.demands)
