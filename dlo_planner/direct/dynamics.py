# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion of the DLO under moving grips: how it begins, its steps, and how far it may be off.

Steps are as long as their error and the energy allow. The error comes from a second run, every
element and every step halved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.direct.equilibrium import equilibrium, past_of
from dlo_planner.direct.integrator import (
    DAMPED,
    FRICTION_LOSS,
    KINETIC,
    STATIC,
    WORK,
    Scheme,
    credit_renewal,
)
from dlo_planner.direct.motion import Deferred, Motion
from dlo_planner.direct.search import KEPT, MAX_ITERATIONS, Search
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.stepper import MOST, Acceptance, StepBatch, Stepper, TimePoint
from dlo_planner.energy.gap import penetration_of_point, penetrations_of_points
from dlo_planner.energy.potential import configuration_at
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.so3 import turn_between
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import array, number, returned, vector
from dlo_planner.model.holds import FarEnd, Hold, Holds, named, place_of, spans_of, unreached
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import Surroundings
from dlo_planner.progress import Progress, interrupted_by

# At time 0: of the nodes, or a callable of s
Velocity: TypeAlias = ArrayLike | Callable[[float], ArrayLike]

_SAME_POSE = 1e-6    # of the length, and rad: poses nearer to each other are the same
_SAME = 1e-9         # of the length, of the energy: what differs by less is the same
_DEEP = 1e-3         # of the length: a DLO so far inside an obstacle is no state of a motion
_FINEST = 96         # elements at least, where an accuracy chooses the mesh
_TOLERANCE = 1e-3    # of the length
_DIFFERENT = 0.1     # of the velocities: what grips and inextensibility may change of them
_AT_REST = 0.01      # of the largest speed before: the same; splines of poses end with 0.005 of it


def refuse_motion(around: Surroundings, strains: str) -> None:
    """Raise InvalidTask where motions in these Surroundings, or by such strains, have no solver."""
    if around.pinned:
        raise InvalidTask('grip = \'pinned\': expected a simulator whose gripper clamps the '
                          'DLO where motions are simulated')
    if strains != 'components':
        raise InvalidTask(f'strains = {strains!r}: expected a simulator with \'components\' '
                          'where motions are simulated')
    if around.has_moments:
        raise InvalidTask('point_loads: expected forces alone in a motion, dead moments have '
                          'no potential')


def motion_tolerance(tolerance: float | None, length: float) -> float:
    """Return the tolerance of a motion in m; infinity is one."""
    if tolerance is None:
        return _TOLERANCE * length
    endless = isinstance(tolerance, float) and tolerance == np.inf
    return tolerance if endless else number('tolerance', tolerance, minimum=1e-9 * length)


def moving_mesh(known: Discretization) -> Discretization:
    """Return a Discretization for motions, as fine as `known`, everywhere L / 96 or finer.

    A mesh that was graded for one shape has to serve all that come.
    """
    s = known.s
    parts = np.ceil(np.diff(s) * (_FINEST / s[-1]) - 1e-9).astype(int)
    if parts.max() <= 1:
        return known
    finer = np.concatenate([np.linspace(one, other, n, endpoint=False) for one, other, n in
                            zip(s, s[1:], parts, strict=False)] + [s[-1:]])
    return Discretization(known.surroundings, finer, known.basis, known.n_terms)


def colliding_mesh(known: Discretization) -> Discretization:
    """Return a Discretization for motions among obstacles: as `known`, but no series.

    One that suits a straight DLO knows no short waves, in which that buckles where it lands.
    """
    if not known.surroundings.obstacles or known.basis == 'local':
        return known
    return Discretization(known.surroundings, known.s, 'local', 0)


def first_shape(discretization: Discretization, gripper: Pose, holds: Holds,
                initial: Shape, memory: Memory | None, goes_on: bool = False) -> Shape:
    """Return the Shape at time 0: that of `initial`, on this mesh and in these surroundings.

    `goes_on`: whether that is where a motion of the same DLO ended.
    """
    length = discretization.s[-1]
    _check_held('gripper', 'grippers[0]', FarEnd(gripper), initial.gripper, length)
    for hold in holds:
        what, where = 'far end', 'far_ends[0]'
        if hold.s is not None:
            what, where = f'place at s = {hold.s:g} m', f'holds[0] of {hold.by}'
        _check_held(what, where, hold, initial.at(place_of(hold, float(initial.s[-1]))), length)
    if goes_on and discretization.touches_itself and initial.state.mesh is discretization:
        return initial  # a search would move strands to where they bear at rest, without springs
    past = past_of(discretization, initial, memory)
    strains = discretization.strains_from(initial.s, initial.element_strains)
    first = equilibrium(discretization, gripper, strains, past, holds, how=Search(0, False))
    first = replace(first, converged=True)  # nothing was solved yet that could have failed
    if initial.state.mesh is discretization and _alike(first, initial):
        first = initial
    if first.converged and first.violation > _DEEP * length:
        raise InvalidTask(f'initial: expected a Shape outside of all obstacles, it is '
                          f'{first.violation:.3g} m inside one')
    return first


def at_full_length(found: Shape, holds: Holds, memory: Memory | None) -> Shape:
    """Return the straight Shape that a motion starts from at full length, else `found`.

    Full length: where grips are exactly as far apart as the DLO is long. There it is the only one,
    and no equilibrium: its forces are not known, its wrenches are nan.
    """
    mesh, gripper = found.state.mesh, found.gripper
    if found.converged or mesh is None or not mesh.loaded:
        return found
    spans = spans_of(holds, gripper, mesh.s.item(-1))
    if all(span.reaches(True) for span in spans) or not all(span.reaches(False) for span in spans):
        return found
    bare = mesh.within(replace(mesh.surroundings, gravity=np.zeros(3), load=None, point_loads=()))
    there = equilibrium(bare, gripper, np.array(bare.free.natural), bare.start, holds)
    if not there.converged:
        return found
    straight = first_shape(mesh, gripper, holds, there, memory)
    return replace(straight, gripper_wrench=np.full(6, np.nan),
                   wrenches=np.full((len(holds), 6), np.nan))


def _check_held(what: str, where: str, grip: Hold, pose: Pose, length: float) -> None:
    """Raise InvalidTask unless a Pose of `initial` is one that a grip allows."""
    rows = grip.held
    miss = rows @ np.concatenate([turn_between(pose.rotation, grip.pose.rotation),
                                  grip.pose.position - pose.position])
    turns = rows[:, :3].any(axis=1)
    turn, shift = np.linalg.norm(miss[turns]), np.linalg.norm(miss[~turns])
    if shift > _SAME_POSE * length or turn > _SAME_POSE:
        raise InvalidTask(f'initial: expected a Shape whose {what} is at {where}, where the '
                          f'motion begins; it is {shift:.3g} m away and {turn:.3g} rad turned')


def _alike(one: Shape, other: Shape) -> bool:
    """Whether two Shapes on one mesh are the same, and know the same energy."""
    away = np.abs(one.positions - other.positions).max()
    size = abs(one.energy) + one.elastic_energy
    return away <= _SAME * one.s[-1] and abs(one.energy - other.energy) <= _SAME * size


def nodes_velocity(velocity: Velocity | None, initial: Shape | None, first: Shape) -> Floats | None:
    """Return (N + 1, 3) m/s at the nodes of the Shape `first`, None for a DLO at rest."""
    if velocity is None:
        return None
    if callable(velocity):
        return np.array([vector(f'velocity({s:g})', returned('velocity', velocity, s), 3)
                         for s in first.s])
    s = first.s if initial is None else initial.s
    given = array('velocity', velocity, (s.size, 3))
    return np.column_stack([np.interp(first.s, s, one) for one in given.T])


def fastest_of(motion: Motion) -> float:
    """Return the largest speed of a node at the instants of a Motion, m/s."""
    return float(np.linalg.norm(motion.velocities, axis=2).max())


def check_velocity(masses: Floats, wanted: Floats, possible: Floats, fastest: float = 0.0) -> None:
    """Raise InvalidTask unless velocities (N + 1, 3) are nearly those that are possible.

    Nearly is by a part of them, or by less of the speed that the motion before had at its
    `fastest`, m/s: where it ended nearly at rest, grips that stand still change all that was left.
    """
    size, change = (np.sqrt(masses @ np.sum(one**2, axis=1)) for one in (
        wanted, possible - wanted))
    if change > max(_DIFFERENT * size, _AT_REST * fastest * np.sqrt(masses.sum())):
        raise InvalidTask(
            'velocity: expected one that the grips and a constant length allow; the nearest such '
            f'motion differs from it by {100 * change / size if size else np.inf:.3g} % '
            '(root mean square by mass)')


HALVINGS = 12  # of an interval between two instants, at most
_SHORTER = 4   # halvings of a step of the finer motion that is not solved
_STILL = 1e-7  # of the length: what moves no farther rests


@dataclass(frozen=True)
class IntegrationOptions:
    """What a motion was computed with, so that it can be repeated."""

    instants: int
    integrator: str
    tolerance: float  # m; infinite: only what cannot be solved or gains energy is halved
    steps: tuple[int, ...] = ()  # numbers of halvings of the steps made, in their order
    chosen: float = np.inf  # place from which on nothing said how it buckled, see `StepBatch`

    def scheme(self, dt: float, halvings: int) -> Scheme:
        """Return the Scheme of a step of dt (s), halved so often."""
        return Scheme(self.integrator, dt / (1 << halvings))


class InitialConditions(NamedTuple):
    """How a motion begins: the Shape that was given, if any, that on its mesh, velocities."""

    initial: Shape | None
    start: Shape
    velocity: Floats | None
    fastest: float = 0.0  # m/s, of any node in the motion that it continues


def error_of(stepper: Stepper, begun: InitialConditions, plan: IntegrationOptions,
             ends: list[float], positions: list[Floats], samples: Floats | None,
             most: float = np.inf) -> Floats:
    """Return (n,) how far, in m, nodes are from the true ones at most until each instant.

    Looked at are all nodes at the instants (their places, and `positions` there) and some of them
    after each step (`samples`, see `StepBatch`). What halving everything changes is three quarters
    of a second-order error, half of a first-order one (Richardson's extrapolation). Where that is
    not known, after `most` times that kernels have asked whether they are to end (which is work,
    not time), it is what doubling everything changes: for a quarter of the work of the motion, all
    of a first-order error, thrice one of second order. Among obstacles, and between strands, it
    depends on when something lands and slips, and is of no order: there the first is taken three
    times, of order one half it were 3.4, and the second twice. Where neither could follow, or they
    are so far apart that nothing foretells where the DLO goes, it is what holds for any two shapes
    in one gripper: twice the length. Where nothing that was given tells how the DLO buckled between
    its grips, it is at least what holds for any two shapes in these.
    """
    made = _Made(ends, positions, samples, _sizes(plan.steps))
    coarse = stepper.discretization
    lands = bool(coarse.surroundings.obstacles) or coarse.touches_itself
    farthest = 2.0 * float(coarse.s[-1])
    most /= _DEAR if lands else 1.0
    found = np.full(len(ends), np.inf)
    parted = _compare(_finer(stepper, made.sizes, _UNGUARDED if lands else 1.0), begun, plan,
                      made, found, most)
    found *= _LANDING if lands else 2.0 if plan.integrator == 'paper' else 4 / 3
    if np.isinf(found).any() and not parted:
        rough = np.full(len(ends), np.inf)
        other = _coarser(stepper, made.sizes, _ROUGH_GAIN)
        # Contacts on another mesh change the energy by more than any useful limit, so the first run
        # has none; if it gets lost, a limit may keep it on the way.
        for gain in (_UNGUARDED, _ROUGH_GAIN) if lands else (_ROUGH_GAIN,):
            told = np.full(len(ends), np.inf)
            if not _compare(other._replace(gain=gain), begun, plan, made, told, _ROUGHLY * most):
                rough = np.where(np.isinf(rough), told, rough)
            if not np.isinf(rough).any():
                break
        found = np.where(np.isinf(found), 2.0 * rough if lands else rough, found)
    chosen = [farthest_between(stepper, place) if place > plan.chosen else 0.0 for place in ends]
    errors: Floats = np.maximum.accumulate(np.minimum(found, farthest))
    errors = np.maximum(errors, np.maximum.accumulate(chosen))
    errors += 1e-15 * coarse.s.size * coarse.s[-1]
    return errors


def farthest_between(stepper: Stepper, place: float) -> float:
    """Return how far nodes of two shapes in the grips at a place may be apart, m.

    Each is within its arc lengths from both grips beside it: in a lens that is that wide.
    """
    gripper, holds = stepper.grips.at(place)
    length = float(stepper.discretization.s[-1])
    if not holds or holds[-1].s is not None:
        return 2.0 * length
    return float(max(np.sqrt(max(span.length**2 - span.distance**2, 0.0))
                     for span in spans_of(holds, gripper, length)))


_UNITS = 2 << HALVINGS  # of time in which steps are counted, in an interval between two instants


class _Made(NamedTuple):
    """What is known of a motion whose error is sought."""

    ends: list[float]        # places of the instants,
    positions: list[Floats]  # (N + 1, 3) of the nodes there, m
    samples: Floats | None   # (k, m, 3) places after each step, see `StepBatch`
    sizes: Ints              # (k,) how long the steps are, in units


class _Other(NamedTuple):
    """A motion of the same DLO, on another mesh and by other steps."""

    stepper: Stepper
    changed: Callable[[Discretization, Holds], Discretization]  # a mesh as this motion's is
    here: Ints   # nodes that both have, of the motion whose error is sought,
    there: Ints  # and of this one
    sizes: Ints  # (k,) how long its steps are, in units
    gain: float  # times what the motion may gain of energy, it may


def _sizes(steps: Sequence[int]) -> Ints:
    """Return (k,) how long steps are that were halved so often, in units."""
    return np.array([2 << (HALVINGS - level) for level in steps], dtype=np.int64)


def _finer(stepper: Stepper, sizes: Ints, gain: float) -> _Other:
    """Return the motion in which all elements and steps are halves."""
    mesh, here = stepper.discretization.finer, np.arange(stepper.discretization.s.size)
    return _Other(Stepper(mesh, stepper.grips, stepper.dt, watched=2 * stepper.watched),
                  lambda known, holds: known.finer, here, 2 * here, np.repeat(sizes // 2, 2), gain)


def _coarser(stepper: Stepper, sizes: Ints, gain: float) -> _Other:
    """Return the motion in which elements and steps are two of those before, as far as they pair.

    Nodes that are watched, held, or where the rod changes are kept.
    """
    known = stepper.discretization
    kept = _every_other(known, stepper.grips.kinds, stepper.watched)
    mesh = Discretization(known.surroundings, known.s[kept], 'local', 0)
    pairs, at, k = [], 0, 0
    while k < sizes.size:
        two = k + 1 < sizes.size and sizes[k] == sizes[k + 1] and at % (2 * sizes[k]) == 0
        pairs.append((1 + two) * sizes[k])
        at, k = at + pairs[-1], k + 1 + two
    return _Other(
        Stepper(mesh, stepper.grips, stepper.dt, watched=np.searchsorted(kept, stepper.watched)),
        lambda mesh, holds: Discretization(
            mesh.surroundings, mesh.s[_every_other(mesh, holds)], 'local', 0),
        kept, np.arange(kept.size), np.array(pairs, dtype=np.int64), gain)


def _every_other(mesh: Discretization, holds: Holds, more: ArrayLike = ()) -> Ints:
    """Return every other node of a mesh, its ends, what cannot be left out, and `more`."""
    last, breaks = mesh.s.size - 1, np.flatnonzero(np.isin(mesh.s, mesh.surroundings.breaks))
    return np.unique(np.concatenate([
        np.arange(0, last, 2), [last], breaks, mesh.held_nodes(holds)[0],
        np.asarray(more, dtype=np.int64)]).astype(np.int64))


# times as long it takes on average, among obstacles, until a kernel or a call of one asks
_DEAR = 4.0
# times what halving everything changes, where something may land: the error, of order one half
_LANDING = 3.0
# times as much work as the finer motion may take the coarser one, which has to come to the end:
# chosen, not measured
_ROUGHLY = 32.0
# times what the motion may gain of energy: the errors of steps twice as long, of second order
_ROUGH_GAIN = 4.0
_UNGUARDED = 1e12  # the same, in effect without a limit
# of the length: motions that are so far apart tell nothing of each other any more
_PARTED = 0.25


class _UsedUp(Exception):
    """An allowance of work is used up."""


class _Allowance:
    """A check of `interrupted_by` that raises _UsedUp when it is asked more than `most` times."""

    def __init__(self, most: float) -> None:
        self._left, self._outer = most, Progress()

    def __call__(self) -> None:
        self._outer.check()
        self._left -= 1
        if self._left < 0:
            raise _UsedUp


def _compare(other: _Other, begun: InitialConditions, plan: IntegrationOptions, made: _Made,
             found: Floats, most: float) -> bool:
    """Fill the largest distances `found` (n,) from another motion, m, as far as that goes.

    With `most` times that kernels ask whether they are to end. Return whether it has ended since
    both have parted.
    """
    with suppress(_UsedUp), interrupted_by(_Allowance(most)):
        return _followed(other, begun, plan, made, found)
    return False


def _followed(other: _Other, begun: InitialConditions, plan: IntegrationOptions, made: _Made,
              found: Floats) -> bool:
    """Do what `_compare` does, without an end."""
    stepper, start = other.stepper, begun.start
    mesh, ends = stepper.discretization, np.cumsum(made.sizes)
    velocity = begun.velocity
    if velocity is not None:
        velocity = np.column_stack([np.interp(mesh.s, start.s, one) for one in velocity.T])
    now = stepper.begin(_start_on(mesh, begun, other.changed), velocity)
    found[0] = worst = _apart(now.positions[other.there], made.positions[0][other.here])
    at, known = 0, 1  # time in units; instants that are known
    energy = _EnergyBudget(now, plan, other.gain)
    for size, steps in groupby(other.sizes.tolist()):
        left, scheme = len(list(steps)), Scheme(plan.integrator, stepper.dt * size / _UNITS)
        if at:
            now = energy.resized(now, scheme.dt)
        while left:
            reached = at + size * np.arange(1, min(left, MOST) + 1)
            batch = energy.steps(now, reached / _UNITS, scheme)
            count = made_here = len(batch.errors)
            if not made_here:
                batch, count = _otherwise(energy, now, size, left, scheme)
            if not count:
                return False
            reached = reached[:count] if made_here else reached[count - 1:count]
            of = np.searchsorted(ends, reached)  # the steps that end there
            both = ends[of] == reached
            if made.samples is not None and both.any():
                worst = max(worst, _apart(batch.samples[both], made.samples[of[both]]))
            for instant in batch.kept:
                k = round(instant.place)
                worst = max(worst, _apart(instant.positions[other.there],
                                          made.positions[k][other.here]))
                found[known:k + 1], known = worst, k + 1
            now, at, left = batch.last, int(reached[-1]), left - count
            if worst > _PARTED * mesh.s[-1]:
                return True
    if now.place == made.ends[-1]:  # of one that ended early, between two instants
        found[known:] = max(worst, _apart(now.positions[other.there],
                                          made.positions[-1][other.here]))
    return False


def _otherwise(energy: _EnergyBudget, now: TimePoint, size: int, left: int,
               scheme: Scheme) -> tuple[StepBatch, int]:
    """Return the StepBatch of a step that is not solved at once, and of how many steps it is.

    It is made in shorter ones, or with the next of the `left` ones in one, since short steps over
    obstacles are solved less exactly; of 0 steps if it is not solved so either.
    """
    at = round(now.place * _UNITS)
    for halvings in (*range(1, _SHORTER + 1), -1):
        count, parts = (1, 1 << halvings) if halvings > 0 else (2, 1)
        if count > left:
            break
        place, brief = (at + count * size) / _UNITS, scheme.dt * count / parts
        trial = energy.copy()
        last = trial.resized(now, brief)
        for k in range(1, parts + 1):
            batch = trial.steps(last, np.array([now.place + (place - now.place) * k / parts]),
                                scheme._replace(dt=brief))
            if batch.refused is not None:
                break
            last = batch.last
        if batch.refused is None:
            last = trial.resized(last, scheme.dt)
            energy.budget = trial.budget
            return batch._replace(kept=[last] if place == round(place) else [], last=last), count
    return batch, 0


def _apart(one: Floats, other: Floats) -> float:
    """Return the largest distance between places (..., 3), m."""
    return float(np.linalg.norm(one - other, axis=-1).max())


def _start_on(mesh: Discretization, begun: InitialConditions,
              changed: Callable[[Discretization, Holds], Discretization]) -> Shape:
    """Return the Shape at time 0 on another mesh, `changed` as those of the motion are.

    A DLO at rest hangs otherwise there: this is a part of the error, and no reason to swing. So is
    one that was at rest in other surroundings, as `initial` may have been.
    """
    start = begun.start
    strains = _at_rest_on(begun.initial or start, mesh, changed)
    if strains is None:
        strains = mesh.strains_from(start.s, start.element_strains)
    state = replace(start.state, mesh=mesh, history=mesh.past(start.state.history))
    there = configuration_at(mesh.system(start.gripper.rotation), strains)
    return replace(start, s=mesh.s, element_strains=strains, frames=there.rotations,
                   positions=there.positions + start.gripper.position, state=state)


def _at_rest_on(shape: Shape, mesh: Discretization,
                changed: Callable[[Discretization, Holds], Discretization]) -> Floats | None:
    """Return the strains (N, 3) on a mesh with which a Shape rests; None: it does not rest."""
    own = shape.state.mesh
    if own is None:
        return None
    here, there = (
        equilibrium(each, shape.gripper, each.strains_from(shape.s, shape.element_strains),
                    each.past(shape.state.history), shape.holds)
        for each in (own, changed(own, shape.holds)))
    moved = np.abs(here.positions - shape.positions).max()
    if not (here.converged and there.converged and moved <= _STILL * own.s[-1]):
        return None
    return mesh.strains_from(there.s, there.element_strains)


_LOOKS = 4           # places between two instants where the grips are looked at
_CLOSE = 3           # halvings of a step that leads a grip into an obstacle, until it is the end
_TAUT = 1.0          # instants before grips are out of reach: what is nearly taut may end there
_PATIENCE = 60       # Newton steps after which it is better to halve the step
_PART = 1 / 600      # of the tolerance: what one step may add to the error
_WELL_WITHIN = 0.6   # of that: a step of twice the length, with 8 times the error, may be tried
_CALM = 16           # steps that all were well within, before it is
_ROUNDED = 1e-8      # of a residual: where rounding errors leave more of it, a step is short
_DAMPING = 3         # halvings of a step that may damp all vibrations, where contacts stir them up
_BEARING = 10.0      # times that, where the DLO bears on an obstacle
_GAIN = 1e-3         # of the energy that has moved: what a motion may gain by rounding and errors


class Run(NamedTuple):
    """What the steps of a motion came to."""

    reached: list[TimePoint]  # at 0, 1, 2 ...; the last one is where it ended: not solved, or the
                              # last before a step that gained energy
    steps: list[int]          # halvings of all steps
    local: float              # m, sum of their local errors
    status: str = 'complete'  # as of `Motion`, like `message`
    message: str = ''
    samples: Floats | None = None  # (k, m, 3) places after each step, see `StepBatch`
    chosen: float = np.inf  # as of IntegrationOptions


def simulate(stepper: Stepper, begun: InitialConditions, plan: IntegrationOptions,
             progress: Progress) -> Motion:
    """Return the Motion that begins so; see `DirectSimulator.simulate`."""
    first = stepper.begin(begun.start, begun.velocity)
    if begun.velocity is not None:
        check_velocity(stepper.masses, begun.velocity, first.velocities, begun.fastest)
    if not begun.start.converged:
        ended = Run([first], [], 0.0, 'unsolved', 'the shape at time 0 was not found')
        return _motion(stepper, ended, plan.tolerance, None)
    too_far = _stays_taut(stepper, plan.instants)
    if too_far:
        return _motion(stepper, Run([first], [], 0.0, 'blocked', too_far), plan.tolerance, None)
    made = run(stepper, first, plan, progress)
    estimate = partial(error_of, stepper, begun,
                       replace(plan, steps=tuple(made.steps), chosen=made.chosen),
                       [instant.place for instant in made.reached],
                       [instant.positions for instant in made.reached], made.samples)
    return _motion(stepper, made, plan.tolerance, estimate)


def run(stepper: Stepper, first: TimePoint, plan: IntegrationOptions, progress: Progress) -> Run:
    """Return the Run that begins with the TimePoint `first`."""
    control, reached = _StepControl(stepper, first, plan), [first]
    blocked, why = _blocked(stepper, plan.instants)
    while len(reached) < plan.instants:
        batch = control.advance(progress)
        progress.check()
        for instant in batch.kept:
            reached.append(instant)
            progress.done(len(reached), plan.instants)
        after = batch.refused
        if after is None:
            continue
        led_in = after.place >= blocked and control.level >= _CLOSE
        if control.stuck:
            too_far = _out_of_reach(stepper, control.now.place,
                                    min(after.place + _TAUT, plan.instants - 1))
            led_in, why = led_in or bool(too_far), too_far or why
        if control.stuck or led_in:
            status = ('blocked' if led_in else 'energy' if after.row.converged else 'unsolved')
            end = replace(after, given=replace(after.shape, converged=False))
            if status == 'energy':  # what has made energy is no instant of this DLO
                end = control.now
            return control.run(reached if end.place == reached[-1].place else [*reached, end],
                               status, why if led_in else _reason(status, stepper, control.now,
                                                                  after.place))
    passed = next((instant for instant in reached if instant.passed), None)
    if passed is not None:
        return control.run(reached, 'self-passage', 'the DLO passes through itself before '
                           f'{passed.place * stepper.dt:.6g} s: nothing holds its pieces off each '
                           'other, and what comes later is no motion of this DLO')
    return control.run(reached)


class _EnergyBudget:
    """The energy that a motion may gain from rounding and discretization errors."""

    def __init__(self, first: TimePoint, plan: IntegrationOptions, times: float = 1.0) -> None:
        mesh, self._stepper = first.stepper.discretization, first.stepper
        self.budget = np.array([first.balance, *first.row.energies[[STATIC, STATIC, KINETIC]],
                                first.balance])
        self.began = first.balance
        self.part, self.guarded = times * _GAIN, times < _UNGUARDED
        # what weight and a bend by 1 rad may do along the ways by which constraints may be missed
        self.noise = times * KEPT * (np.abs(mesh.load).sum() * mesh.rod.length
                                     + max(mesh.rod.stiffness[1:]) / mesh.rod.length)
        self.limit = np.inf if plan.integrator == 'paper' else self.noise

    def copy(self) -> _EnergyBudget:
        """Return another one with as much left."""
        other = copy(self)
        other.budget = self.budget.copy()
        return other

    def resized(self, now: TimePoint, dt: float) -> TimePoint:
        """Return the TimePoint from which steps of dt (s) go on, if that makes no energy up."""
        fresh = self._stepper.resized(now, dt)
        return fresh if credit_renewal(self.budget, fresh.balance, self.began, self.noise) else now

    def steps(self, now: TimePoint, places: Floats, scheme: Scheme) -> StepBatch:
        """Return the StepBatch of steps of a Scheme that end at `places` (n,), of any error."""
        # (of so many halvings or more: 1.5 is between the lengths of two levels, 1 and 2)
        damps = self.guarded and scheme.dt < 1.5 * self._stepper.dt / (1 << _DAMPING)
        batch = self._stepper.steps(now, (), places, scheme, Acceptance(
            part=self.part, noise=self.limit, budget=self.budget, began=self.began, damps=damps))
        self.budget = batch.budget
        return batch


class _StepControl:
    """Makes the steps of a motion, as long as they may be.

    It is `stuck` where the next step after `now` is not good, however short it is.
    """

    def __init__(self, stepper: Stepper, first: TimePoint, plan: IntegrationOptions) -> None:
        self.now, self.stuck = first, False
        self._stepper, self._plan = stepper, plan
        self._fixed = plan.integrator == 'paper'
        self._obstructed = not self._fixed and bool(
            stepper.discretization.surroundings.obstacles)
        place, speed, acceleration = first.row.nodes[:3]  # as if it had moved evenly till now
        self._past = [(-dt, place - dt * speed + 0.5 * dt**2 * acceleration)
                      for dt in (2 * stepper.dt, stepper.dt)]
        self._at = self._level = self._calm = 0  # time in the shortest steps; halvings; steps
        self._failed: tuple[int, set[int]] = -1, set()  # a time, halvings of steps tried from there
        self._steps: list[int] = []
        self._errors: list[float] = []
        self._samples: list[Floats] = []
        self._energy = _EnergyBudget(first, plan)
        self._chosen = np.inf

    @property
    def level(self) -> int:
        """How often the next step is to be halved."""
        return self._level

    def run(self, reached: list[TimePoint], status: str = 'complete', message: str = '') -> Run:
        """Return the Run so far."""
        return Run(reached, self._steps, float(sum(self._errors)), status, message,
                   np.concatenate(self._samples) if self._samples else None, self._chosen)

    def advance(self, progress: Progress) -> StepBatch:
        """Return the StepBatch of the next steps, which are entered here."""
        level = self._level
        last_try = level == HALVINGS or self._fixed
        batch = self._steps_of(level, last_try)
        if batch.refused is not None and self._obstructed and (last_try or level >= self._short
                and (batch.last.row.after_impact or len(batch.refused.row.contacts))):
            batch = (batch._replace(refused=None) if len(batch.errors)
                     else self._try_other_steps(batch, progress))
        if batch.refused is not None:
            self.stuck = last_try
            self._level, self._calm = min(level + 1, HALVINGS), 0
        elif level and self._calm >= _CALM and self._at % (2 << (HALVINGS - level)) == 0:
            self._level, self._calm = level - 1, 0
        return batch

    @cached_property
    def _short(self) -> int:
        """How often a step is halved until it is so short that rounding errors count.

        Among obstacles a shorter one is not solved more easily, and tells no more.
        """
        return next((level for level in range(HALVINGS) if self._stepper.rounding(
            self._plan.scheme(self._stepper.dt, level)) > _ROUNDED), HALVINGS)

    def _try_other_steps(self, batch: StepBatch, progress: Progress) -> StepBatch:
        """Return a StepBatch of a step that is good though a short one is not, or `batch` of that.

        The shorter a step over obstacles is, the larger are the forces of what is pressed in, and
        the more sets of contacts are tried: a step that was too long for a few Newton steps, and
        ends elsewhere, may be found by many.
        """
        left = (1 << HALVINGS) - self._at % (1 << HALVINGS)  # until the next instant
        if self._failed[0] != self._at:
            self._failed = self._at, set()
        for level in range(min(self._level, HALVINGS - 1), -1, -1):
            if 1 << (HALVINGS - level) > left:
                break
            if level in self._failed[1]:
                continue
            self._failed[1].add(level)
            progress.check()
            longer = self._steps_of(level, True, 1)
            if len(longer.errors):
                return longer
        return batch

    def _steps_of(self, level: int, patient: bool, most: int = MOST) -> StepBatch:
        """Return a StepBatch of the next steps, `most` of them at most, which are entered here."""
        plan, stepper = self._plan, self._stepper
        scheme = plan.scheme(stepper.dt, level)
        now, energy = self.now, self._energy.copy()
        if self._steps and self._steps[-1] != level:
            now = energy.resized(now, scheme.dt)
        error = np.inf if level == HALVINGS or self._fixed else _PART * plan.tolerance
        damps, reach = level >= _DAMPING or most == 1, 0.0  # (one is made where shorter ones fail)
        if damps:
            reach = (np.inf if level >= _DAMPING and (most == 1 or level >= self._short)
                     else plan.tolerance)
        limits = Acceptance(
            MAX_ITERATIONS if patient else _PATIENCE, error, _BEARING * error, reach, energy.part,
            energy.limit, energy.budget, energy.began, damps)
        size = 1 << (HALVINGS - level)
        count = min(most, self._length(size))
        places = (self._at + size * np.arange(1, count + 1)) / (1 << HALVINGS)
        batch = stepper.steps(now, self._past, places, scheme, limits)
        made = len(batch.errors)
        if made:
            self.now, self._past = batch.last, batch.past
            energy.budget = batch.budget
            self._energy = energy
            self._at += made * size
            self._chosen = min(self._chosen, batch.chosen)
            self._steps += [level] * made
            self._errors += batch.errors.tolist()
            self._samples.append(batch.samples)
        rough = np.flatnonzero(8 * batch.errors >= _WELL_WITHIN * _PART * plan.tolerance * (
            _BEARING if batch.last.row.after_impact else 1.0))
        self._calm = made - 1 - int(rough[-1]) if rough.size else self._calm + made
        return batch

    def _length(self, size: int) -> int:
        """Return how many steps are to be made before their length may change."""
        most = min(MOST, (((self._plan.instants - 1) << HALVINGS) - self._at) // size)
        if not self._level:
            return most
        calm = max(_CALM - self._calm, 1)
        return min(most, calm + (self._at // size + calm) % 2)


def _reason(status: str, stepper: Stepper, now: TimePoint, place: float) -> str:
    times = f'from {now.place * stepper.dt:.6g} s to {place * stepper.dt:.6g} s'
    if status == 'energy':
        return f'a step {times} gains energy, however short it is'
    shape = now.shape
    return (f'the step {times} could not be solved, however short it is; before it the sharpest '
            f'bend was {np.abs(shape.element_strains).max():.3g} 1/m, '
            f'{len(shape.contacts)} contacts')


def _blocked(stepper: Stepper, instants: int) -> tuple[float, str]:
    """Return where a grip is first led into an obstacle, infinity if it is not, and it in words.

    There a DLO that is clamped has no shape outside of obstacles (see `Solution.inside`).
    """
    mesh, grips = stepper.discretization, stepper.grips
    if not mesh.surroundings.obstacles:
        return np.inf, ''
    places, deep = np.arange((instants - 1) * _LOOKS + 1) / _LOOKS, KEPT * mesh.s[-1]
    held = [('gripper', grips.gripper)]
    held += [('far end' if hold.s is None else named(hold), path)
             for hold, path in zip(grips.kinds, grips.paths, strict=True) if not hold.slides]
    first = np.inf, ''
    for what, grip in held:
        depths = penetrations_of_points(mesh.scene, np.array(grip.along(places)[1]))
        inside = np.flatnonzero(depths > deep)
        if inside.size and places[inside[0]] < first[0]:
            before, at = places[max(inside[0] - 1, 0)], float(places[inside[0]])
            while at - before > 1 / (1 << HALVINGS):
                middle = 0.5 * (before + at)
                if penetration_of_point(mesh.scene, np.array(grip.at(middle).position)) > deep:
                    at = middle
                else:
                    before = middle
            first = at, (f'from {at * stepper.dt:.6g} s on the motion leads the {what} into an '
                         f'obstacle, until the end by up to {depths.max():.3g} m: no shape of the '
                         'DLO can follow')
    return first


def _stays_taut(stepper: Stepper, instants: int) -> str:
    """Return in words that grips stay at full length from the beginning on, '' if they do not.

    Under a load no shape follows then. Where they come nearer later steps tell how long inertia
    bears the load.
    """
    mesh, too_far = stepper.discretization, ''
    if not mesh.loaded or instants < 2:
        return ''
    for place in range(instants):
        gripper, holds = stepper.grips.at(float(place))
        too_far = unreached(holds, gripper, mesh.s.item(-1), True)
        if not too_far:
            return ''
    return f'out of reach: from the beginning on {too_far}: no shape of the DLO can follow'


def _out_of_reach(stepper: Stepper, begin: float, end: float) -> str:
    """Return where grips are out of reach of each other from one place to another, in words.

    '' where they are not. A motion may begin at the full length.
    """
    mesh, grips = stepper.discretization, stepper.grips
    for place in np.arange(np.floor(begin * _LOOKS), np.floor(end * _LOOKS) + 1) / _LOOKS:
        gripper, holds = grips.at(float(place))
        too_far = unreached(holds, gripper, float(mesh.s[-1]), mesh.loaded and place > 0.0)
        if too_far:
            return (f'out of reach: at {place * stepper.dt:.6g} s {too_far}: no shape of the DLO '
                    'can follow')
    return ''


def _motion(stepper: Stepper, made: Run, tolerance: float,
            estimate: Callable[[float], Floats] | None) -> Motion:
    reached, message = made.reached, made.message
    places = np.array([instant.place for instant in reached])
    if made.status == 'complete' and made.local > tolerance:
        message = (f'the local errors of its steps add up to {made.local:.3g} m, more than the '
                   f'tolerance of {tolerance:.3g} m: see error_estimate')
    given = {} if estimate is None else {'_estimate': estimate}
    energies = np.array([instant.row.energies for instant in reached])
    shapes: Any = Deferred(lambda: tuple(instant.shape for instant in reached))
    return Motion(
        stepper.dt * places, shapes,
        np.array([instant.velocities for instant in reached]), energies[:, KINETIC],
        energies[:, STATIC], energies[:, WORK], energies[:, DAMPED:FRICTION_LOSS + 1], tolerance,
        made.status, message, **given)
