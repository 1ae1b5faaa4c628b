# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Following one shape through a motion of its grips, and noticing where it lets go.

A step is taken as it is where nothing speaks against it: no more motion than the grips can cause,
no energy lost that neither work nor friction accounts for, no unstable shape on the way (`sound`).
Where a contact comes, goes, turns over an edge, or begins to slide, two half steps have to lead to
the same shape as well; where one goes, the step is short. Any other step is made in halves, and so
is any of a DLO that lies on something: two halves that change it about as much are its step. What
is still in doubt in the shortest parts is a fall: it is made, and said. Until then what falls along
obstacles is followed only so far that this is known: each fall is made once. What hangs freely
remembers nothing of its way: after a fall all that is left of that is tried at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import ceil, log2
from typing import NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.discretization import SAMPLES, stretched
from dlo_planner.direct.energy_balance import work_of_grips
from dlo_planner.direct.equilibrium import (
    AlongWay,
    equilibrium,
    error_of_fall,
    error_of_step,
    error_of_way,
    past_of,
)
from dlo_planner.direct.grips import Grips, frame_inside, grips_at
from dlo_planner.direct.self_passage import has_passed
from dlo_planner.direct.shape import LYING, Shape, Try
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.geometry.kinematics import carried_frames, trace_of_product
from dlo_planner.geometry.so3 import matrix, rotation_vector, times_transposed, transposed_times
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.holds import Holds, alike, carried_on, counterpart, have_rings, spans_of
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Constant, changed, freeze

Equilibrium: TypeAlias = Callable[..., Shape]  # of (gripper, initial, holds, `StepInputs.most`)

LONGEST_TURN = 0.25     # rad: longer steps of the gripper are cut in any case
_LONGEST_SHIFT = 0.05   # of the length: the same, of a DLO that touches
_SHORTEST = 5e-5        # rad and of the length: of parts in which a discontinuity counts as a jump
# The same of a DLO that lies on something: where it lets go depends on friction by more
_SHORTEST_LYING = 2e-3
_FINEST = 32            # equal parts, at most, in which a step is made again for its accuracy
_LEAST, _MOST = 3, 14   # how often a step in doubt may be halved
_FAILURES = 7           # the same, where no equilibrium is found
_AFTER = 3              # the same, for what comes after a jump
_DISCONTINUITY = 0.1    # rad: change of shape that a vanishing step of the gripper cannot cause
_DISCONTINUITY_ON = 0.05   # the same, of a DLO that touches
_DISCONTINUITY_OFF = 0.02  # the same, of a DLO that comes off an obstacle
_OFF = 2e-3             # rad and of the length: the longest step in which it does
_FOLLOWING = 3.0        # rad of shape per rad of the gripper: more is looked at in smaller steps
_SPREAD = 0.2           # of how much the work depends on when forces change in a step: its error
_ROUGH = 0.01           # of the elastic energy: what may be lost where no discontinuity is seen
_EXACT = 1e-6           # of the elastic energy: what may always be lost, an error of solvers
_THERE = 1e-8           # rad and of the length: what is left of a way that has been gone
_EVENLY = 0.75          # of a step's change: more in half of it is a discontinuity, perhaps
_SAME = 0.01            # rad: two shapes that differ by less are one
_SLIDES = 1 - 1e-6      # of friction's limit
_TURNED = np.cos(0.5)   # rad: a normal that turns more is another contact, as beyond an edge
# rad of shape, per rad and length of the gripper: what lies turns by 8 to 15 as it goes along; with
# more it falls, and is followed no farther before it is known from where
_STEEPEST = 30.0


def follow(take: Equilibrium, previous: Shape, gripper: Pose, holds: Holds = (),
           at_once: bool = False, halvings: int | None = None, tried: Shape | None = None,
           falls: bool = False, counted: bool = False) -> Shape:
    """Return the Shape at `gripper` that continues `previous`; its `jumped` says if none does.

    None does where, in parts of the step however short, it changes more than these can cause,
    loses energy that neither work nor friction accounts for, or comes from an unstable shape: that
    has lost its stability there, and the DLO takes one of several sides (a pitchfork).

    Args:
        take: takes a step
        previous: Shape before the step
        gripper, holds: where the grips are to be
        at_once: whether what hangs freely goes in one step however far the gripper turns
        halvings: how often a part of a step may be made in halves; None: it is the whole step
        tried: Shape of this part, if it is known
        falls: whether it is known to fall in this part, which is made in halves at once
        counted: whether the error of its way is wanted however short that is
    """
    whole, last = halvings is None, halvings == 0
    if whole:
        mesh = previous.state.mesh
        if mesh is not None and mesh.surroundings.pinned:  # the DLO turns in a ball joint
            gripper = Pose.from_rotation(gripper.position, previous.gripper.rotation)
    if holds and have_rings(holds):
        holds = carried_on(holds, previous.holds)
    goal = Grips(gripper, holds)
    way = _way(previous, goal)
    if falls and not last:
        return _in_parts(take, previous, goal, way, halvings, None, None, False, np.inf,
                         counted=counted)
    touched = bool(previous.contacts)
    if (len(previous.contacts) >= LYING and alike(previous.holds, holds) and not last
            and way.size > 2.0 * _SHORTEST_LYING and not _is_long(way, True, at_once)):
        even, half, end = _evenly(take, previous, goal)
        if even and end is not None and not _comes_off(previous, end):
            there = _led(previous, end)
            if there.passed_itself is False:
                return _with_error_of_way(previous, there)
        return _in_parts(take, previous, goal, way, halvings, None, half,
                         not (half.converged or half.state.kicks), np.inf, end,
                         end is not None and _has_fallen(half, end), counted)
    shape: Shape | None = None
    first: Shape | None = None
    most, failed = np.inf, False
    if last or not _is_long(way, touched, at_once):
        in_contact = touched and not holds
        if touched and not last:
            most = _most_in_contact(way)
        elif not (last or at_once or touched or holds):
            most = _DISCONTINUITY + _FOLLOWING * way.turn
        if tried is None or last and tried.state.kicks:
            tried = take(gripper, previous, holds, most)
        shape = tried
        if not (shape.converged or shape.state.kicks) and (
                shape.jumped or holds and whole and not _may_be_reached_in_parts(shape)):
            return shape  # the way is blocked, or out of reach
        good, touches = sound(previous, shape, way), touched or bool(shape.contacts)
        if good and (last or not _changes(previous, shape)):
            if last or not shape.contacts or not _is_long(way, touches, at_once):
                shape = _led(previous, shape)
                if counted and not last and shape.contacts:  # (the shortest parts tell nothing)
                    shape = _with_error_of_step(previous, shape)
                if last or way.size <= _OFF or shape.passed_itself is False:
                    return shape  # else shorter ways tell whether it really does
        elif last:
            return _led(previous, _fallen(previous, shape))
        elif ((good or in_contact and _keeps_energy(previous, shape))
              and not _is_long(way, touches, at_once)
              and not (way.size > _OFF and _comes_off(previous, shape))):
            agree, first, end = _by_halves(take, previous, goal, shape)
            if agree:  # (the longer a step, the more friction depends on its parts)
                shape = _led(previous, shape if good else end)
                if counted and shape.contacts:
                    shape = (_with_error_of_step if good else _with_error_of_way)(previous, shape)
                if way.size <= _OFF or shape.passed_itself is False:
                    return shape
        failed = not shape.converged and (most == np.inf or touched and not shape.state.kicks)
        falls = _has_fallen(previous, shape)
    found = _in_parts(take, previous, goal, way, halvings, shape, first, failed, most, falls=falls,
                      counted=counted)
    if whole and holds and failed and shape is not None:
        # only grips that could not be reached at once are reported
        halves = Try('in halves', 'found' if found.converged else 'not converged')
        found = changed(found, state=changed(found.state, tried=(*shape.state.tried, halves)))
    return found


def followed_within(accuracy: float, take: Equilibrium, previous: Shape, shape: Shape,
                    goal: Grips) -> Shape:
    """Return a Shape with as many parts of its way as keep the error of that in an accuracy, m.

    Each part adds an error of second order in its length: n of them leave an n-th of it. No more
    are tried where even the most would leave too much.

    Args:
        accuracy, take, previous, goal: of the step
        shape: what `follow` has led to, whose way is `counted`
    """
    parts = 1
    while (more := _parts_needed(shape, accuracy)) > 1 and parts * more <= _FINEST:
        parts *= more
        finer = _in_equal_parts(take, previous, goal, parts)
        if finer is None:
            return shape
        shape = finer
    return shape


def _parts_needed(shape: Shape, accuracy: float) -> int:
    """Return in how many parts a way is in an accuracy, m; 1: it is, or no parts could help."""
    estimate = shape.state.estimate
    if shape.jumped or not shape.converged or not isinstance(estimate, AlongWay):
        return 1
    off = shape.error_estimate
    left = accuracy - estimate.on_mesh()
    if off <= accuracy or left <= 0.0:
        return 1
    return 2 if off == np.inf else 2 ** ceil(log2(1.0 + (off - accuracy) / left))


def _in_equal_parts(take: Equilibrium, previous: Shape, goal: Grips, parts: int) -> Shape | None:
    """Return the Shape at the `goal`, which is followed to in so many parts, or None."""
    shape = previous
    for left in range(parts, 0, -1):
        holds = carried_on(goal.holds, shape.holds) if have_rings(goal.holds) else goal.holds
        there = goal if left == 1 else grips_at(shape, holds).towards(
            goal._replace(holds=holds), 1.0 / left)
        rest = follow(take, shape, there.gripper, there.holds, counted=True)
        if not rest.converged:
            return None
        shape = rest if left == parts else _joined(shape, rest)
    return shape


def _may_be_reached_in_parts(shape: Shape) -> bool:
    """Whether a step to all grips of a Shape that is no equilibrium may be found in parts.

    Among obstacles, if these grips can be reached. What is straight behind a grip goes with it, and
    may be stopped by the DLO.
    """
    mesh = shape.state.mesh
    if mesh is None:
        return False
    if mesh.touches_itself:
        return True
    spans = spans_of(shape.holds, shape.gripper, float(shape.s[-1]))
    return mesh.obstructed and all(span.reaches(mesh.loaded) for span in spans)


def _has_fallen(previous: Shape, shape: Shape) -> bool:
    """Whether a step left an unstable shape, or changed more than the motion of grips can cause."""
    return bool(shape.state.kicks) or shape.converged and fell(previous, shape)


def _in_parts(take: Equilibrium, previous: Shape, goal: Grips, way: Way, halvings: int | None,
              shape: Shape | None, half: Shape | None, failed: bool, most: float,
              end: Shape | None = None, falls: bool = False, counted: bool = False) -> Shape:
    """Return what `follow` does, in two halves.

    Args:
        take, previous, goal, way, halvings: of `follow`
        shape: what the step leads to at once, if that has been looked for
        half: what its first half leads to, the same
        failed: whether no equilibrium is found at once
        most: see `StepInputs`: with which `shape` was found
        end: what the second half leads to from `half`, if that has been looked for
        falls: whether all of it falls: then the second half does if the first one does not
        counted: of `follow`
    """
    whole = halvings is None
    if halvings is None:
        shortest = _SHORTEST_LYING if len(previous.contacts) >= LYING else _SHORTEST
        parts = max(way.size / shortest, 1.0)
        halvings = min(max(ceil(log2(parts)), _LEAST), _MOST)
    left = (min(halvings, _FAILURES) if failed else halvings) - 1
    there = _partway(previous, goal)
    lying = shape is None and half is not None  # two halves of what lies were looked at
    middle = follow(take, previous, there.gripper, there.holds, False, left, half,
                    lying and half is not None and _has_fallen(previous, half), counted)
    if not middle.converged:
        if shape is None and not (whole and lying):
            return _jumped(middle)
        return _led(previous, _fallen(previous, _to_its_end(
            take, previous, goal, shape, most, whole)))
    while True:
        fell_and_lies = middle.jumped and len(middle.contacts) >= LYING
        if not whole and (fell_and_lies or middle.jumped and left >= _AFTER
                          and middle.state.culled and not goal.holds):
            return middle  # what is left of the way is for the step that all of it began with
        known = end if half is not None and middle.state is half.state else None
        after = min(left, _AFTER) if middle.jumped else left
        rest = follow(take, middle, goal.gripper, goal.holds, False,
                      0 if fell_and_lies else after, known, falls and not middle.jumped, counted)
        if fell_and_lies and not rest.converged:
            rest = follow(take, middle, goal.gripper, goal.holds, False, after, rest,
                          counted=counted)
        if not rest.converged and (whole and lying if shape is None else
                                   whole or shape.converged):
            # the whole step may have an end, which its parts do not reach
            return _led(previous, _fallen(previous, _to_its_end(
                take, previous, goal, shape, most, whole)))
        short = rest.jumped and _way(rest, goal).size > _THERE
        jumped, passed = rest.jumped or middle.jumped, _either(middle, rest)
        if (not short and shape is not None and shape.converged and shape.state.culled
                and not goal.holds and shape_change(rest, shape) <= _SAME):
            rest = shape  # what hangs freely does not remember its way, nor shall its mesh
        if rest.passed_itself is not passed:
            rest = changed(rest, passed_itself=passed)
        rest = _after_way(middle, rest)
        if not whole or not short:
            return _jumped(rest) if jumped else rest
        middle = _jumped(rest)


def _with_error_of_way(previous: Shape, shape: Shape, fell: bool = False) -> Shape:
    """Return a Shape that knows the error of its way from a previous one, in two halves or fell."""
    mesh = shape.state.mesh
    if mesh is None:
        return shape
    strains = previous.element_strains
    if not mesh.has_nodes(previous.s):
        strains = mesh.strains_from(previous.s, strains)
    way = partial(error_of_fall if fell else error_of_way, mesh, shape.gripper, shape.positions,
                  previous.gripper, strains, past_of(mesh, previous, None), shape.holds)
    ways, falls = ((), (way,)) if fell else ((way,), ())
    estimate = AlongWay(shape.state.estimate, ways, falls)
    return changed(shape, state=changed(shape.state, estimate=estimate))


def _with_error_of_step(previous: Shape, shape: Shape) -> Shape:
    """Return a Shape with the error of a single step from a previous one, if it rubs."""
    mesh = shape.state.mesh
    if (mesh is None or shape.state.feed is not None or not alike(previous.holds, shape.holds)
            or not any(one.friction.any() for one in shape.contacts)):
        return shape
    strains = previous.element_strains
    if not mesh.has_nodes(previous.s):
        strains = mesh.strains_from(previous.s, strains)
    there = _partway(previous, Grips(shape.gripper, shape.holds))
    way = partial(error_of_step, mesh, shape.gripper, shape.positions, previous.gripper, strains,
                  past_of(mesh, previous, None), shape.holds, there)
    return changed(shape, state=changed(shape.state, estimate=AlongWay(
        shape.state.estimate, (way,))))


def _fallen(previous: Shape, shape: Shape) -> Shape:
    """Return a Shape that a DLO has fallen into in a step from a previous one: it says so.

    What hangs freely does not remember its way. Of what slides through rings it is not known how
    far elsewhere that may have landed: anywhere.
    """
    if shape.jumped or not (shape.converged and shape.contacts):
        return _jumped(shape)
    if shape.state.feed is not None:
        estimate = AlongWay(shape.state.estimate, falls=(Constant(np.inf),))
        return _jumped(changed(shape, state=changed(shape.state, estimate=estimate)))
    return _with_error_of_way(previous, _jumped(shape), True)


def _joined(middle: Shape, rest: Shape) -> Shape:
    """Return the Shape after another part of a step, which says what happened on both ways."""
    there, passed = _after_way(middle, rest), _either(middle, rest)
    if there.passed_itself is not passed:
        there = changed(there, passed_itself=passed)
    return _jumped(there) if middle.jumped else there


def _after_way(middle: Shape, shape: Shape) -> Shape:
    """Return the Shape after another part of a step, with the errors of both ways.

    What hangs freely does not remember how it has rubbed; where it fell, it may still hang on
    another side.
    """
    known, own = middle.state.estimate, shape.state.estimate
    if not isinstance(known, AlongWay):
        return shape
    there = own if isinstance(own, AlongWay) else AlongWay(own)
    ways = known.ways + there.ways if shape.contacts else ()
    estimate = AlongWay(there.on_mesh, ways, known.falls + there.falls)
    return changed(shape, state=changed(shape.state, estimate=estimate))


def _led(previous: Shape, shape: Shape) -> Shape:
    """Return a Shape that says whether the DLO passed through itself on the way to it."""
    mesh, known = shape.state.mesh, previous.state.mesh
    if (mesh is not None and known is not None and shape.elastic_energy <= mesh.bending_back
            and previous.elastic_energy <= known.bending_back):
        return shape  # neither bends by a right angle, as of nearly all that hangs freely
    passed = has_passed(previous, shape, shape.jumped)
    return shape if passed is shape.passed_itself else changed(shape, passed_itself=passed)


def _either(one: Shape, other: Shape) -> bool | float:
    """Return whether the DLO passed through itself on the ways to two Shapes together."""
    both = one.passed_itself, other.passed_itself
    return next((passed for passed in both if passed is True),
                next((passed for passed in both if passed is not False), False))


def _evenly(take: Equilibrium, previous: Shape,
            goal: Grips) -> tuple[bool, Shape, Shape | None]:
    """Return whether two half steps change a DLO that lies about as much; the Shapes after them.

    None of the second one where the first has led nowhere.

    What is discontinuous is so in one of them. Its friction depends on how long steps are, and
    contacts come and go in most of them: the whole step in addition would say no more.
    """
    there = _partway(previous, goal)
    most = _most_in_contact(_way(previous, there))
    first = take(there.gripper, previous, there.holds, most)
    if not _keeps_energy(previous, first):
        return False, first, None
    end = take(goal.gripper, first, goal.holds, most)
    if not _keeps_energy(first, end):
        return False, first, end
    change = max(shape_change(previous, first), shape_change(first, end))
    return (change <= max(_DISCONTINUITY_OFF, _EVENLY * shape_change(previous, end)), first, end)


def _by_halves(take: Equilibrium, previous: Shape, goal: Grips,
               shape: Shape) -> tuple[bool, Shape, Shape]:
    """Return whether two half steps lead to `shape` as well; and the Shapes after these.

    They do not where one of them alone changes as much as both: a discontinuity is one in any step.
    """
    there = _partway(previous, goal)
    in_contact = bool(previous.contacts) and not goal.holds
    most = _most_in_contact(_way(previous, there)) if previous.contacts else np.inf
    follows = _keeps_energy if in_contact else sound
    first = take(there.gripper, previous, there.holds, most)
    if not follows(previous, first, _way(previous, there)):
        return False, first, first
    end = take(goal.gripper, first, goal.holds, most)
    agree = (follows(first, end, _way(first, goal)) and not _changes(shape, end)
             and shape_change(shape, end) <= _SAME)
    if agree:
        change = max(shape_change(previous, first), shape_change(first, end))
        agree = change <= max(_DISCONTINUITY_OFF, _EVENLY * shape_change(previous, shape))
    return agree, first, end


def _to_its_end(take: Equilibrium, previous: Shape, goal: Grips, shape: Shape | None,
                most: float, whole: bool) -> Shape:
    """Return where a step leads that was given up, or is a fall; else its Shape as it is.

    `most`: with which it was found, see `StepInputs`; it may not have been looked for yet (None).
    What is not found so in a part of a step is not looked for any farther: that is for the `whole`.
    """
    if shape is not None and (most == np.inf or (
            not shape.state.kicks if shape.converged else not whole)):
        return shape
    return take(goal.gripper, previous, goal.holds, np.inf)


def _jumped(shape: Shape) -> Shape:
    """Return a Shape that says so; itself, with its error estimate, if it does already."""
    return shape if shape.jumped else changed(shape, jumped=True)


def _partway(previous: Shape, goal: Grips) -> Grips:
    """Return where the grips are halfway from a Shape to `goal`."""
    return grips_at(previous, goal.holds).towards(goal, 0.5)


class Way(NamedTuple):
    """How far grips go in a step, from where they are in a Shape."""

    shift: float        # of the gripper, of the length
    turn: float         # of the gripper, rad; 0 of a ball joint, with which no DLO turns
    held: float | None  # of all else that is held, rad and of the length; None: nothing is

    @property
    def size(self) -> float:
        """The sum of all."""
        return self.shift + self.turn + (self.held or 0.0)


def _way(previous: Shape, goal: Grips) -> Way:
    """Return the Way of the grips from where they are in a Shape to `goal`."""
    length, held = float(previous.s[-1]), 0.0 if goal.holds else None
    one, other = previous.gripper, goal.gripper
    if held is not None:
        for hold in goal.holds:
            frame, position = previous.frames[-1], previous.positions[-1]
            if hold.s is not None:
                frame, position = frame_inside(previous, hold.s)
            held += _missed(hold.held, frame, position, hold.pose.rotation, hold.pose.position,
                            length)
    shift, turn = _motion(one.rotation, one.position, other.rotation, other.position)
    return Way(shift / length, 0.0 if previous.pinned else turn, held)


@kernel
def _motion(rotation: Floats, position: Floats, there: Floats, goal: Floats) -> tuple[float, float]:
    """Return how far a gripper goes, m, and turns, rad, as exact near 0 as near pi.

    Shapes: rotation (3, 3) and position (3,) where it is, `there` and `goal` where it goes.
    """
    product = transposed_times(matrix(rotation), matrix(there))
    x, y, z = goal[0] - position[0], goal[1] - position[1], goal[2] - position[2]
    u, v, w = product[7] - product[5], product[2] - product[6], product[3] - product[1]
    return (float(np.sqrt(x * x + y * y + z * z)),
            float(np.arctan2(np.sqrt(u * u + v * v + w * w),
                             product[0] + product[4] + product[8] - 1.0)))


@kernel
def _missed(rows: Floats, frame: Floats, position: Floats, rotation: Floats, place: Floats,
            length: float) -> float:
    """Return how far a node is from a grip that holds `rows` (K, 6), rad and of the length.

    Shapes: frame (3, 3) and position (3,) of the node, those of the grip.
    """
    turn = rotation_vector(times_transposed(matrix(rotation), matrix(frame)))
    turned = shifted = 0.0
    for row in range(rows.shape[0]):
        by_turn = by_shift = 0.0
        for i in range(3):
            by_turn += rows[row, i] * turn[i]
            by_shift += rows[row, 3 + i] * (place[i] - position[i])
        turned += by_turn * by_turn
        shifted += by_shift * by_shift
    return float(np.sqrt(turned) + np.sqrt(shifted) / length)


def _most_in_contact(way: Way) -> float:
    """Return by how much, in rad, what touches may turn in a step before it is known to fall."""
    return _DISCONTINUITY_ON + _STEEPEST * way.size


def _is_long(way: Way, touches: bool, at_once: bool) -> bool:
    """Whether a step is cut in any case; it `touches` before or after."""
    if way.held is not None:
        return False  # the ends go in small parts anyway
    if touches and way.shift > _LONGEST_SHIFT:
        return True
    return way.turn > LONGEST_TURN and (touches or not at_once)


def sound(previous: Shape, shape: Shape, way: Way) -> bool:
    """Return whether nothing speaks against a step of the grips from `previous` to `shape`."""
    return (shape.converged and not shape.state.kicks and not fell(previous, shape, way)
            and not _passes(previous, shape))


def _keeps_energy(previous: Shape, shape: Shape, _: Way | None = None) -> bool:
    """Return whether nothing but the size of a step speaks against it; arguments as of `sound`.

    What lies on something turns by many times more than its grip.
    """
    return (shape.converged and not shape.state.kicks and not _passes(previous, shape)
            and (_let_go(previous, shape) or not _lost(previous, shape)))


def surely_follows(previous: Shape, shape: Shape) -> bool:
    """Return whether `follow` takes `shape`, found in one step, as it is; arguments as `sound`."""
    way = _way(previous, Grips(shape.gripper, shape.holds))
    return (sound(previous, shape, way) and not _changes(previous, shape)
            and not _is_long(way, bool(previous.contacts or shape.contacts), False)
            and _led(previous, shape).passed_itself is False)


def fell(previous: Shape, shape: Shape, way: Way | None = None) -> bool:
    """Return whether `shape` does not continue `previous` in a single step of the grips, a `way`.

    It changed more than their motion can cause; or, in contact, pinned or with its far end held, it
    lost energy that neither work nor friction accounts for.
    """
    change, way = shape_change(previous, shape), way or _way(
        previous, Grips(shape.gripper, shape.holds))
    if not (previous.contacts or shape.contacts or shape.holds or shape.pinned):
        return change > _DISCONTINUITY + _FOLLOWING * way.turn  # its shift deforms nothing
    least = _DISCONTINUITY_OFF if _comes_off(previous, shape) else _DISCONTINUITY_ON
    if change > least + _FOLLOWING * way.size:
        return True
    return not _let_go(previous, shape) and _lost(previous, shape)


def _let_go(previous: Shape, shape: Shape) -> bool:
    """Whether a place that was held is not held any more, which frees energy."""
    for hold in previous.holds:
        for other in shape.holds:
            if hold.s == other.s or hold.is_ring and other.is_ring and counterpart(
                    hold, previous.holds, shape.holds) is other:
                break
        else:
            return True
    return False


def _lost(previous: Shape, shape: Shape) -> bool:
    """Whether less energy is left than the work of both grips and friction account for.

    What does not count is the error of the work, and what bends all of the DLO by a discontinuity.
    """
    previous = _on_mesh_of(shape, previous)
    work, spread = work_of_grips(previous, shape)
    lost = previous.energy + work - shape.energy - (shape.dissipated - previous.dissipated)
    energy = max(previous.elastic_energy, shape.elastic_energy)
    least = _SPREAD * spread + _EXACT * energy
    if lost <= least:
        return False
    past, mesh, feed = shape.state.history, shape.state.mesh, shape.state.feed
    if past is not None and (shape.contacts or shape.self_contacts):
        lost -= past.friction_work
    if feed is not None:
        lost -= feed.work
    if not shape.holds or shape_change(previous, shape) <= _DISCONTINUITY_ON:
        least += _ROUGH * energy
        if mesh is not None:
            stiffness = float(mesh.free.stiffness[:, 1:].min())
            least += 0.5 * _DISCONTINUITY_ON**2 * stiffness / float(shape.s[-1])
    return lost > least


def _on_mesh_of(shape: Shape, previous: Shape) -> Shape:
    """Return the Shape before a step on the mesh after it: energies of two meshes tell no fall."""
    mesh, known = shape.state.mesh, previous.state.mesh
    if mesh is None or known is None or mesh is known or (
            mesh.has_nodes(previous.s) and mesh.n_unknowns == known.n_unknowns):
        return previous
    if shape.state.feed is not None:
        return _on_stretched_mesh_of(shape, previous)
    there = equilibrium(mesh, previous.gripper,
                        mesh.strains_from(previous.s, previous.element_strains),
                        mesh.past(previous.state.held), previous.holds,
                        culled=previous.state.culled)
    return there if there.converged else previous


def _on_stretched_mesh_of(shape: Shape, previous: Shape) -> Shape:
    """Return what `_on_mesh_of` does where the DLO slides: nodes go with what is in the rings."""
    mesh, known = shape.state.made_on, previous.state.made_on
    if alike(previous.holds, shape.holds) and mesh.s.size == known.s.size:
        return previous  # stretched alike
    places = [other.s if (other := counterpart(hold, shape.holds, previous.holds)) else hold.s
              for hold in shape.holds]
    there = tuple(hold if s is None else hold.at_place(s)
                  for hold, s in zip(shape.holds, places, strict=True))
    mesh = stretched(mesh, shape.holds, there, mesh)
    stuck = tuple(hold.stuck for hold in previous.holds)
    found = equilibrium(mesh, previous.gripper,
                        mesh.strains_from(previous.s, previous.element_strains),
                        mesh.past(previous.state.held), stuck, culled=previous.state.culled)
    return found if found.converged else previous


def _comes_off(previous: Shape, shape: Shape) -> bool:
    """Whether an obstacle that was touched is not touched any more."""
    return not ({contact.obstacle for contact in previous.contacts}
                <= {contact.obstacle for contact in shape.contacts})


def _changes(one: Shape, other: Shape) -> bool:
    """Whether contacts come, go, turn over an edge, or begin or cease to slide between Shapes."""
    if not (one.contacts or other.contacts):
        return False
    obstacles = other.obstacles
    before, after = _states(one, obstacles), _states(other, obstacles)
    return not (_each_in(before, after) and _each_in(after, before))


def _states(shape: Shape, obstacles: tuple[Obstacle, ...]) -> dict[tuple[int, bool], list[Floats]]:
    """Return the normals of contacts, by the obstacle and whether they slide on it."""
    states: dict[tuple[int, bool], list[Floats]] = {}
    for contact in shape.contacts:
        friction = obstacles[contact.obstacle].friction if obstacles else 0.0
        limit = _SLIDES * friction * contact.force
        slides = friction > 0.0 and contact.friction @ contact.friction >= limit * limit
        states.setdefault((contact.obstacle, bool(slides)), []).append(contact.normal)
    return states


def _each_in(some: dict[tuple[int, bool], list[Floats]],
             others: dict[tuple[int, bool], list[Floats]]) -> bool:
    """Whether each of the normals `some` is about one of the `others` of the same state."""
    for state, normals in some.items():
        known = others.get(state)
        if known is None or (np.array(normals) @ np.array(known).T).max(axis=1).min() < _TURNED:
            return False
    return True


def _passes(previous: Shape, shape: Shape) -> bool:
    """Whether a DLO that touches neither before nor after goes through an obstacle in between."""
    mesh = shape.state.mesh
    if (previous.contacts or shape.contacts or mesh is None or not mesh.obstructed
            or shape.state.culled):  # the step has looked at the way
        return False
    if not mesh.has_nodes(previous.s):
        return False
    arrays = (previous.element_strains, previous.frames, previous.positions, shape.frames,
              shape.positions)
    return bool(sweeps_through(mesh.scene, mesh.free.lengths,
                               *(np.array(array) for array in arrays)))


def shape_change(one: Shape, other: Shape) -> float:
    """Return the largest change of a node's rotation relative to the gripper, in rad."""
    if one.state.feed is not None or other.state.feed is not None:
        return _change_between_rings(one, other)
    if one.s is other.s and one.state.mesh is not None:
        return largest_turn_between(one.frames, other.frames, one.gripper.rotation,
                                    other.gripper.rotation, one.state.mesh.sampled)
    if np.array_equal(one.s, other.s):
        at = np.searchsorted(one.s, SAMPLES * one.s[-1])
        here, there = one.frames[at], other.frames[at]
    else:  # nodes of two meshes are not at the same places
        samples = SAMPLES * one.s[-1]
        here, there = (np.array([shape.frame_at(s)[0] for s in samples / one.s[-1] * shape.s[-1]])
                       for shape in (one, other))
    freeze((here, there))
    return largest_turn_between(here, there, one.gripper.rotation, other.gripper.rotation,
                                np.arange(SAMPLES.size))


def _change_between_rings(one: Shape, other: Shape) -> float:
    """Return the same where the DLO slides: of as large parts of what is between rings.

    And by how much it slides, of the length.
    """
    length, mine, theirs = float(one.s[-1]), [0.0], [0.0]
    for hold in other.holds:
        known = counterpart(hold, other.holds, one.holds) if hold.is_ring else None
        if known is not None and known.s is not None and hold.s is not None:
            mine.append(known.s)
            theirs.append(hold.s)
    slides = max(abs(a - b) for a, b in zip(mine, theirs, strict=True)) / length
    samples = SAMPLES * length
    there = np.interp(samples, [*mine, length], [*theirs, float(other.s[-1])])
    frames, others = (np.array([shape.frame_at(s)[0] for s in at.tolist()])
                      for shape, at in ((one, samples), (other, there)))
    freeze((frames, others))
    turn = largest_turn_between(frames, others, one.gripper.rotation, other.gripper.rotation,
                                np.arange(SAMPLES.size))
    return max(float(turn), slides)


@kernel
def largest_turn_between(frames: Floats, others: Floats, base: Floats, other_base: Floats,
                         nodes: Ints) -> float:
    """Return the largest rotation in rad, in the gripper, of some nodes (k,) between two shapes."""
    before = carried_frames(frames, base, other_base, nodes)
    least = 3.0
    for k in range(nodes.size):
        least = min(least, trace_of_product(others[nodes[k]], before[k]))
    return float(np.arccos(min(max(0.5 * (least - 1.0), -1.0), 1.0)))
