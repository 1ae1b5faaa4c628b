# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Statics of a DLO on one mesh: from the shape before to the next, with its proof.

A step is sought by one strategy after the other, cheapest first, until one finds an equilibrium;
`State.tried` names them. An obstacle that is not touched and a yield stress that is not reached add
zeros to the equations. So a step is made first without them, and a compiled sweep
(`energy.terms.may_act`) looks at the end of the step and at the straight way to it. Where something
acts, or the DLO remembers something, it is made with all that may act.

Where the DLO goes on bearing on obstacles, or in all its grips, a step is a correction of the
shape before. Else the grips are moved to their places, around obstacles where that can be
(`direct.placement`), and the minimum is sought from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.accuracy import (
    bears_otherwise,
    fine_enough,
    fine_enough_to_bend,
    foreseen,
    judged,
    made_with_a_set,
    mesh_to_begin_with,
    refined,
    surely_within,
    with_error_confirmed,
)
from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.direct.energy_balance import overspent
from dlo_planner.direct.equilibrium import (
    UNWATCHED,
    Watch,
    bearing_on,
    equilibrium,
    halved,
    held_nearby,
    moved_from,
    past_of,
    search_of,
    shape_of,
)
from dlo_planner.direct.grips import Grips, grips_at
from dlo_planner.direct.placement import by_parts, moved, set_down, small_steps
from dlo_planner.direct.search import KEPT, described_minimum
from dlo_planner.direct.shape import LYING, Shape, Try, hinge_of
from dlo_planner.energy.gap import penetration_of_point
from dlo_planner.energy.potential import configuration_at
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Holds, alike, places_of, spans_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Constant, changed, freeze, put, read_only
from dlo_planner.progress import INTERRUPT

_DOUBTFUL = 2.0  # times the accuracy: what is expected to be off by more is off
_OF_FIRST_SET = 0.25  # part of the accuracy: what is wanted where a DLO begins to yield
_IN_PARTS = 300  # Newton steps of what may be sought in smaller parts


class StepInputs(NamedTuple):
    """How a DLO is held in a step, what it begins with, and how its shape is sought."""

    memory: Memory | None = None  # that it starts with if there is no Shape of it before
    holds: Holds = ()
    method: str = 'newton'        # as of `DirectSimulator`, like `strains`
    strains: str = 'components'
    # rad, by which a DLO that hangs freely may turn, see `Watch`; if it is finite, a fall onto
    # obstacles or along them is wanted no more exactly than the first mesh has it, and what is not
    # found soon is sought in smaller parts
    most: float = np.inf


ALONE = StepInputs()


class StepSolver(NamedTuple):
    """Takes steps of a DLO on the mesh that each needs, as a `DirectSimulator` is asked to."""

    first: Discretization
    fine: str                # basis of better meshes
    accuracy: float | None   # m; None: all steps are made on the first mesh
    memory: Memory | None    # what the DLO starts with if there is no Shape of it before
    method: str
    strains: str
    goal: Grips | None = None  # where the step ends; a step to anywhere else is part of its way
    promised: bool = False     # whether a shape that misses the accuracy counts as none

    def take(self, gripper: Pose, initial: Shape | None, holds: Holds = (),
             most: float = np.inf) -> Shape:
        """Return the Shape that follows `initial` (a Shape or None); `most` as in `StepInputs`."""
        check = INTERRUPT.get()
        if check is not None:  # a pose that is far, or a fall, takes many steps
            check()
        how = StepInputs(self.memory, holds, self.method, self.strains, most)
        if self.accuracy is not None:
            return _accurate(self, gripper, initial, how)
        mesh = self.first
        if holds and holds[0].s is not None:  # (the tip's is the last)
            mesh = mesh.with_nodes(places_of(holds))
        return step(mesh, gripper, initial, how)

    def passes(self, gripper: Pose, holds: Holds) -> bool:
        """Return whether these grips are not yet at the end of the step, but on the way to it."""
        return self.goal is not None and not (
            gripper is self.goal.gripper and holds is self.goal.holds)


def _accurate(solver: StepSolver, gripper: Pose, initial: Shape | None, how: StepInputs) -> Shape:
    """Return a Shape on a mesh for the accuracy of a `solver`: its first, or better ones.

    Starts on the mesh of `initial` (a Shape or None), so that a motion pays for grading once.
    A shape that misses the accuracy on the largest mesh says so: `converged` is False. What is in
    contact may miss it on any: that is for `judged` to say, at the end of a step.
    """
    first, fine, wanted = solver.first, solver.fine, solver.accuracy
    assert wanted is not None
    accuracy, holds = wanted, how.holds
    inside = places_of(holds) if holds and holds[0].s is not None else ()
    if inside:
        fine = 'local'  # see `Discretization.with_nodes`
    mesh = mesh_to_begin_with(first, fine, accuracy, initial, how.memory)
    if holds:
        from dlo_planner.direct.taut import bent_mesh  # noqa: PLC0415  (SciPy: a free DLO needs none)
        if first.obstructed and initial is None:
            mesh = fine_enough_to_bend(mesh, fine)
        mesh = bent_mesh(mesh.with_nodes(inside) if inside else mesh, gripper, holds, fine)
    begin, start, kicks, expected = initial, None, 0, np.inf
    while True:
        shape = step(mesh, gripper, begin, how, start)
        if not shape.converged and not (begin is initial and start is None):
            # a coarser mesh has led nowhere
            shape = step(mesh, gripper, initial, how)
        kicks += shape.state.kicks
        if kicks > shape.state.kicks:  # those on the meshes before count as well
            shape = changed(shape, state=changed(shape.state, kicks=kicks))
        if not shape.converged:
            finer = None
            if shape.hinge is not None and shape.outlier is None:  # these elements may be too long
                finer = refined(mesh, fine, shape, accuracy)
            elif (mesh.basis != fine and how.most == np.inf and not shape.jumped
                  and initial is not None and initial.contacts):
                finer = refined(mesh, fine, shape, accuracy)  # a series waves between contacts
            if finer is None:
                return shape
            mesh, start, expected = finer.with_nodes(inside) if inside else finer, None, np.inf
            continue
        if kicks and how.most < np.inf and not shape.state.culled:  # a fall is made in parts
            return shape
        if shape.dissipated:
            lasts = made_with_a_set(shape)
            if lasts and (fine == 'local' or initial is not None and mesh == initial.state.mesh):
                return shape
            accuracy = (1.0 if lasts else _OF_FIRST_SET) * wanted
        if (initial is not None and initial.contacts and mesh is initial.state.mesh
                and solver.passes(gripper, holds) and not shape.dissipated):
            return shape  # the end of the way tells whether the mesh is fine enough
        if expected < np.inf:
            shape = with_error_confirmed(shape, expected)
        # the first mesh is hardly ever fine enough: then nothing else is computed on it
        new = mesh is first and (initial is None or initial.state.mesh != mesh)
        better = None
        if new and fine == 'local' and not surely_within(shape, accuracy):
            better = foreseen(shape, accuracy, _DOUBTFUL)
        if better is None:
            kinked = shape.dissipated and mesh.basis != fine  # no series follows where it yields
            if not kinked and fine_enough(shape, accuracy) and not (
                    solver.promised and first.obstructed and bears_otherwise(shape, accuracy)):
                return shape
            better = foreseen(shape, accuracy) if fine == 'local' else None
        if better is not None:
            mesh, start, expected = better
        else:
            finer = refined(mesh, fine, shape, accuracy)
            if finer is None:
                return judged(shape, wanted)
            mesh, start, expected = finer.with_nodes(inside) if inside else finer, None, np.inf
        if initial is None and _may_dissipate(first):
            # what is set down has no way on which it rubs or yields: it is the start that counts
            if start is None and not shape.dissipated:
                start = mesh.strains_from(shape.s, shape.element_strains)
        elif initial is None or not _way_counts(shape):
            begin = shape  # a better start; else the step is made again


def _may_dissipate(mesh: Discretization) -> bool:
    """Whether a DLO may lose energy on its way: what yields, or rubs."""
    around = mesh.surroundings
    return bool(around.rod.yields or any(one.friction for one in around.obstacles))


def _way_counts(shape: Shape) -> bool:
    """Whether a Shape that follows another depends on the way, and not only on where that ended."""
    around = shape.state.made_on.surroundings
    return bool(shape.holds or not shape.state.culled and (around.rod.yields or around.obstacles))


def step(mesh: Discretization, gripper: Pose, initial: Shape | None, how: StepInputs = ALONE,
         start: Floats | None = None) -> Shape:
    """Return the Shape that follows `initial` (a Shape or None) on a mesh.

    The search begins with the strains `start` (N, 3), if any, instead of those of `initial`.
    """
    if initial is not None and not initial.converged and initial.impossible:
        # neither its strains nor the set that it would leave are those of a DLO
        how, initial = how._replace(memory=initial.state.before or how.memory), None
    past = past_of(mesh, initial, how.memory)
    idle = (how.method == 'newton' and mesh.may_hang and past.idle
            and (mesh.hangs or mesh.touches_itself or not how.holds or initial is not None))
    tried: list[Try] = []
    for culled in (True, False) if idle else (False,):
        for strategy, found in _strategies(mesh, gripper, initial, how, past, start, culled):
            if found is None:
                tried.append(Try(strategy, 'not near'))
                continue
            shape, acts = found, culled and not found.state.culled
            tried.append(Try(strategy, 'not converged' if not shape.converged else
                             'something acts' if acts else 'found'))
        if not culled or mesh.hangs:
            break
        given_up = not shape.converged and how.most < np.inf  # then it is made in parts
        if given_up or shape.converged and not acts and not (
                mesh.touches_itself and initial is not None and _may_have_met(initial, shape)):
            break
        if mesh.touches_itself and initial is None and shape.converged:
            start = shape.element_strains  # from where strands in each other are pushed apart
    put(shape.state, tried=tuple(tried))
    return _with_set_judged(shape, initial) if mesh.yields else shape


# names, and the Shape of each, None if there is none near
Strategies: TypeAlias = Iterator[tuple[str, Shape | None]]


def _strategies(mesh: Discretization, gripper: Pose, initial: Shape | None, how: StepInputs,
                past: Memory, start: Floats | None, culled: bool) -> Strategies:
    """Try one strategy after the other; yield each with its Shape, None if there is none near.

    `culled`: without what may act. They are named in `Shape.tried`.
    """
    holds, newton = how.holds, how.method == 'newton'
    if start is not None:
        strains = read_only(start)
    elif initial is None:
        strains = mesh.stress_free(past)
    elif mesh.has_nodes(initial.s):
        strains = initial.element_strains
    else:
        strains = read_only(mesh.strains_from(initial.s, initial.element_strains))
    watch = _watched(mesh, initial, how.most) if culled else None if initial is None else (
        UNWATCHED._replace(rotation=initial.gripper.rotation, most=how.most))
    if culled and not holds:
        yield 'free', equilibrium(mesh, gripper, strains, past, culled=True, watch=watch)
        return
    if how.strains == 'paper':
        system = mesh.local.system(gripper.rotation, gripper.position, past)
        yield 'paper', shape_of(mesh.local, gripper, described_minimum(
            mesh, system, strains, how.method), past)
        return
    shape = None
    if newton and initial is not None:
        if not holds:
            shape = bearing_on(mesh, gripper, initial, strains, past)
            if shape is not None and mesh.touches_itself and _may_have_met(initial, shape):
                shape = None
            yield 'bearing on', shape
        elif alike(initial.holds, holds):
            shape = held_nearby(mesh, gripper, strains, past, holds, culled, watch)
            yield 'near', shape
        else:
            past = changed(past, hold=_forces_that_stay(initial.holds, past.hold, holds))
        if shape is not None:
            return
    if initial is None:
        yield from _set_down(mesh, gripper, how, past, strains, culled, watch, start is not None)
        return
    if mesh.surroundings.pinned:  # it does not turn with its gripper
        gripper = Pose.from_rotation(gripper.position, initial.gripper.rotation)
    begin = moved(mesh, initial, strains, Grips(gripper, holds), past, culled)
    search = search_of(mesh, begin.gripper, holds)
    if len(initial.contacts) >= LYING:
        search = search._replace(steps=min(search.steps, _IN_PARTS))
    shape = equilibrium(mesh, begin.gripper, begin.strains, begin.memory, holds, method=how.method,
                        culled=culled, watch=watch, how=search)
    yield 'moved', shape if begin.clear else replace(shape, converged=False, jumped=True)
    if newton and not shape.converged and _may_be_led(mesh, gripper, holds, culled):
        yield 'in steps', _led(mesh, strains, past, grips_at(initial, holds),
                               Grips(gripper, holds), culled)


def _set_down(mesh: Discretization, gripper: Pose, how: StepInputs, past: Memory, strains: Floats,
              culled: bool, watch: Watch | None, is_there: bool) -> Strategies:
    """Yield what `_strategies` does for a DLO that comes from nowhere with strains (N, 3).

    `is_there`: whether it is nearly in its grips with them already, by another mesh.
    """
    holds, newton, goal = how.holds, how.method == 'newton', Grips(gripper, how.holds)
    natural, known = strains, past
    if holds and not is_there:
        gripper, strains, past, _ = set_down(mesh, strains, goal, past, _settled)
        if newton:
            shape = held_nearby(mesh, gripper, strains, past, holds, culled, watch)
            yield 'set down', shape
            if shape is not None:
                return
    shape = equilibrium(mesh, gripper, strains, past, holds, method=how.method, culled=culled,
                        watch=watch)
    yield 'set down', shape
    if (newton and not (shape.converged or is_there or mesh.yields)
            and _may_be_led(mesh, goal.gripper, holds, culled)):
        led = _led(mesh, natural, known, Grips(goal.gripper), goal, culled)
        yield 'in steps', led
        if led is not None:
            return
    if mesh.obstructed:
        if (newton and not culled and shape.violation > KEPT * mesh.s[-1]
                and _may_come_out(mesh, gripper, holds)):
            yield 'from elsewhere', _from_elsewhere(mesh, gripper, past, holds)
    elif (newton and not shape.converged and places_of(holds)
          and _may_come_out(mesh, gripper, holds)):
        yield 'by parts', _joined(mesh, gripper, past, holds)


def _may_be_led(mesh: Discretization, gripper: Pose, holds: Holds, culled: bool) -> bool:
    """Return whether grips may lead a DLO to where they are in small steps, a shape in each.

    Not among obstacles and strands, where they may be stuck; nor to where it does not reach.
    """
    around, amid = mesh.surroundings, mesh.touches_itself or mesh.obstructed and not culled
    return bool(holds) and not (amid or around.pinned or around.has_moments) and all(
        span.reaches(mesh.loaded) for span in spans_of(holds, gripper, float(mesh.s[-1])))


def _led(mesh: Discretization, strains: Floats, past: Memory, begin: Grips, goal: Grips,
         culled: bool) -> Shape | None:
    """Return the Shape at a `goal` to which grips lead a DLO in small steps, or None.

    It has strains (N, 3) and a past in the grips in which it begins; the gripper alone, and it
    comes to rest there first.
    """
    shape = equilibrium(mesh, begin.gripper, strains, past, begin.holds, culled=culled)
    begin, in_vain = grips_at(shape, goal.holds), 0
    for there in small_steps(begin, goal, float(mesh.s[-1])):
        past = past_of(mesh, shape, past)
        near = held_nearby(mesh, there.gripper, shape.element_strains, past, there.holds, culled)
        if near is None:
            at = moved(mesh, shape, shape.element_strains, there, past, culled)
            near = equilibrium(mesh, at.gripper, at.strains, at.memory, there.holds, culled=culled,
                               how=search_of(mesh, at.gripper, there.holds)._replace(
                                   steps=_IN_PARTS))
        if near.converged:
            shape, in_vain = near, 0
        elif in_vain or there is goal:
            return None
        else:
            in_vain += 1  # beyond where it leaps, the next may be found
    return shape


def _settled(mesh: Discretization, gripper: Pose, holds: Holds) -> Shape:
    """Return the Shape in which a DLO settles that is set down in its grips."""
    return step(mesh, gripper, None, StepInputs(holds=holds))


def _joined(mesh: Discretization, gripper: Pose, memory: Memory, holds: Holds) -> Shape | None:
    """Return the Shape next to what `by_parts` returns, or None."""
    found = by_parts(mesh, gripper, holds, memory, _settled)
    if found is None:
        return None
    shape = equilibrium(mesh, found.gripper, found.strains, found.memory, holds)
    return shape if shape.converged else None


def _forces_that_stay(before: Holds, forces: Floats, holds: Holds) -> Floats:
    """Return forces (K,) of Holds: of those that held `before` theirs, else 0."""
    counts = [len(hold.held) for hold in before]
    if forces.size != sum(counts):
        return np.zeros(0)
    known = {(hold.s, hold.grip): part for hold, part in zip(
        before, np.split(forces, np.cumsum(counts)[:-1]), strict=True)} if before else {}
    return np.concatenate([known.get((hold.s, hold.grip), np.zeros(len(hold.held)))
                           for hold in holds])


def _from_elsewhere(mesh: Discretization, gripper: Pose, memory: Memory,
                    holds: Holds) -> Shape | None:
    """Return the Shape that falls onto the obstacles from above, or swings against them; or None.

    Where a DLO is first inside obstacles the way out may be above them, where its dead loads would
    lift it, or below, where it would hang without them. It yields on the last way alone.
    """
    bare = mesh.within(replace(mesh.surroundings, obstacles=()))
    lifted = bare.varied(pull=-bare.free.load.pull)
    for one in (lifted, bare) if mesh.loaded else (bare,):
        there = _settled(one, gripper, holds)
        if there.converged:
            shape = equilibrium(mesh, there.gripper, there.element_strains, memory, holds)
            if shape.converged:
                return shape
    return None


def _may_come_out(mesh: Discretization, gripper: Pose, holds: Holds) -> bool:
    """Return whether the gripper is in no obstacle, and all that holds within reach."""
    length = float(mesh.s[-1])
    inside = penetration_of_point(mesh.scene, np.array(gripper.position))
    return inside <= KEPT * length and all(
        span.reaches(mesh.loaded) for span in spans_of(holds, gripper, length))


def _may_have_met(initial: Shape, shape: Shape) -> bool:
    """Return whether strands may have met on the way between two Shapes."""
    from dlo_planner.direct.self_contact import may_have_met  # noqa: PLC0415  (few need it)
    return may_have_met(initial, shape)


def _watched(mesh: Discretization, before: Shape | None, most: float) -> Watch:
    """Return what a step from `before` (None: stress-free) is watched for; `most`: StepInputs."""
    if before is None:
        return UNWATCHED
    if mesh.has_nodes(before.s):
        if most == np.inf:
            return Watch(before.positions, rotation=before.gripper.rotation)
        return Watch(before.positions, before.frames, before.gripper.rotation, mesh.sampled, most)
    if mesh.hangs:
        return UNWATCHED
    strains, pose = mesh.strains_from(before.s, before.element_strains), before.gripper
    places = configuration_at(mesh.system(pose.rotation, culled=True), strains).positions
    freeze(places := places + pose.position)
    return UNWATCHED._replace(places=places, rotation=pose.rotation)


def _with_set_judged(shape: Shape, initial: Shape | None) -> Shape:
    """Return a Shape whose history knows how exact its permanent set is, if it can be one.

    The set that a step makes is as exact as the step; what comes later tells nothing of it. It
    cannot take more energy than the step was given. Where it gathers in one element (`hinge_of`),
    no mesh tells how far that bends: neither this shape nor one that follows it is an answer.
    """
    before, after, state = shape.state.before, shape.state.history, shape.state
    if before is None or after is None or not after.has_set:
        return shape
    if not shape.converged:
        return _without_set(shape, before) if shape.impossible else shape
    if before.original_set is None and np.array_equal(before.plastic, after.plastic):
        return shape
    excess = 0.0 if initial is None else overspent(initial, shape)
    if excess > 0.0:
        return _without_set(replace(shape, converged=False, state=replace(
            state, overspent=excess)), before)
    finer = halved(state.made_on, shape.gripper, shape.element_strains, before, shape.holds,
                   state.culled)
    hinge = hinge_of(shape, finer)
    error = np.inf if finer is None else moved_from(state.made_on, shape.positions, finer,
                                                    state.culled)
    if hinge is not None:
        return replace(shape, converged=False, state=replace(
            state, history=replace(after, hinge=hinge), estimate=Constant(np.inf)))
    return replace(shape, state=replace(
        state, history=changed(after, set_error=max(before.set_error, error)),
        estimate=Constant(error)))


def _without_set(shape: Shape, before: Memory) -> Shape:
    """Return a Shape that leaves to the next step the set that was there before it."""
    return replace(shape, state=replace(shape.state, history=before.permanent_part()))
