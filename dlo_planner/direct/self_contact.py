# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that touches itself: which pairs of its elements bear, and how much.

Newton's method seeks the minimum with springs between strands and forces that stand beside them
(`energy.strands`); then the forces take over what the springs bore, until these bear nothing
(method of multipliers: Nocedal and Wright, ch. 17.4). Pairs are looked for anew in each round.

Friction counts from the shape before the step, as it does on obstacles: what it was there, less a
spring times the slip since then, within Coulomb's cone. In a round its limits are those of the
forces of the round before, and its directions those of the shape there. The end is where both
change nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.direct.search import KEPT, Search
from dlo_planner.direct.self_passage import TURNING, bends_little
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.problem import Configuration, Problem
from dlo_planner.energy.strands import (
    NO_RAYS,
    Strands,
    bears,
    near_pairs,
    nearest_points,
    put_friction,
    put_slips,
    smooth_strands,
)
from dlo_planner.minimize.solve import Solution
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose

# Steps of Newton's method: until pairs are looked for anew, the same where none are near, and in
# all, in steps of a search: a DLO that falls winds itself up bit by bit
_STEPS, _FREE, _MORE = 10, 100, 5
# Of the sum of both radii: by how much strands that lie on each other among obstacles give first,
# under all loads on the DLO: springs that hardly give let a search that slides them go to and fro
_PRESSED = 0.02
_ROUGH = 1e-3      # residual: with a larger one the forces are those of a shape that is none
# Where new forces leave to the springs more than this part of what these bore before, springs
# become so many times as stiff, at most so many times as stiff as at first (Nocedal and Wright,
# alg. 17.4)
_SLOWLY, _STIFFER, _STIFFEST = 0.25, 3.0, 100.0
_CREEPS = 1e-3     # of the length: what moves by less in so many steps does not fall
_STUCK = 1e-8      # of the length: what bears on itself and moves by less is stuck
# Strands that are nearer than this part of the sum of both radii are thin at first, and grow:
# each time to so many times their thickness, and by this part of their radius more
_SHALLOW, _GROWTH, _LEAST = 0.9, 1.2, 0.02
# Of the larger radius, and of the longest element: pairs as near as that beyond both radii are
# looked at. What slides off the end of an element comes to the next one, which has to be known
_WATCHED, _BESIDE = 0.5, 1.0
_FALLEN = 1.5      # rad: what bends or twists by more in a step, in all, may have fallen
_EXACT = 1e-7      # of the length: depths aimed at
# Of the radius: by how much springs of friction give at most before it slides, if they are not as
# stiff as those between strands anyway. They are at first as stiff as the second part of that, and
# become so many times as stiff in each round: what slides far on stiff springs goes to and fro
_GIVES, _SOFT, _FIRMER = 0.01, 1e-3, 10.0
_PATIENCE = 10     # rounds with friction that hardly move anything: its limits follow in each
_CONE = 1e-6       # of the largest force between strands: by how much friction may be off


def may_have_met(previous: Shape, shape: Shape) -> bool:
    """Return whether strands may have met on the way from one Shape to another, however it went.

    They have not where each is farther from all others than both move, seen from the gripper. What
    bends or twists by much has fallen, and may have made and lost a loop on its way.
    """
    mesh, places, strains = shape.state.made_on, previous.positions, previous.element_strains
    if not mesh.has_nodes(previous.s):
        places, strains = previous.positions_at(mesh.s), mesh.strains_from(previous.s, strains)
    change = np.linalg.norm(shape.element_strains - strains, axis=1)
    if float(mesh.free.lengths @ change) > _FALLEN:
        return True
    if bends_little(previous) and bends_little(shape):
        return False
    before, after = ((one - one[0]) @ frame for one, frame in (
        (places, previous.frames[0]), (shape.positions, shape.frames[0])))
    behind, then = (rays_behind(one.gripper, one.holds, float(mesh.s[-1])) @ one.frames[0]
                    for one in (previous, shape))
    moved = max(float(np.linalg.norm(b - a, axis=1).max())
                for a, b in ((before, after), (behind, then)))
    return any(len(_pairs(mesh.free.lengths, bends, rays, one, mesh.radii, 2.0 * moved))
               for one, bends, rays in ((before, strains, behind),
                                        (after, shape.element_strains, then)))


def rays_behind(gripper: Pose, holds: Holds, length: float) -> Floats:
    """Return the `Strands.rays` of a DLO of a length, m, in these grips."""
    if not holds or holds[-1].s is not None or holds[-1].grip not in TURNING:
        return NO_RAYS
    return length * np.array([gripper.rotation[:, 0], holds[-1].pose.rotation[:, 0]])


class Step(NamedTuple):
    """A step of a DLO that may touch itself, in its grips and among its obstacles."""

    mesh: Discretization
    memory: Memory  # what it begins with
    # the Problem without Strands, whose contacts and holds have the forces of a Memory
    system_of: Callable[[Memory], Problem]
    # the Solution that a Search reaches from strains (N, 3)
    solved: Callable[[Problem, Floats, Search], Solution]
    after: Callable[[Solution], Memory]  # what a Solution leaves

    def going_on(self, end: Solution) -> Problem:
        """Return the Problem with the forces at a Solution, friction counted from the beginning."""
        return self.system_of(self.memory.under(self.after(end)))


def kept_apart(step: Step, strains: Floats, how: Search) -> Solution:
    """Return the Solution in which no strand is in another, found from strains (N, 3).

    Its Strands are those that are near. Where strands are deep in each other at first, as of a DLO
    that is set down, they are thin and grow.
    """
    mesh, memory, system = step.mesh, step.memory, step.system_of(step.memory)
    pairs = _pairs_at(mesh, system, strains)
    known = {(i, j): force for (i, j), force in zip(
        mesh.pairs_at(memory.strands).tolist(), memory.strands[:, 2].tolist(), strict=True)}
    thick = min([1.0, *(distance / reach for distance, reach in pairs)])
    while thick < _SHALLOW:
        end = _kept_apart(step, mesh.radii * thick, {}, False, strains, how._replace(check=False))
        if not end.residual < np.inf:
            break  # as thick as it is it may be found all the same
        strains, thick = end.strains, min(_GROWTH * thick + _LEAST, 1.0)
    return _kept_apart(step, mesh.radii, known, mesh.rubs_itself, strains, how)


Forces = dict[tuple[int, int], float]  # N, of pairs


def _kept_apart(step: Step, radii: Floats, known: Forces, rubs: bool, strains: Floats,
                how: Search) -> Solution:
    """Return what `kept_apart` does of strands with these radii (N,) and known forces.

    `rubs`: whether they rub on each other.
    """
    mesh, memory, system = step.mesh, step.memory, step.system_of(step.memory)
    lengths, rays, spring = mesh.free.lengths, system.rays, _first_spring(mesh, known)
    positions = _places(system, strains)
    length, left, rests, iterations, kicks = float(mesh.s[-1]), np.inf, False, 0, 0
    firm, crept, in_vain, end = _SOFT, 0, False, None
    while True:
        strands = _near(lengths, strains, rays, positions, radii, known, spring)
        if end is not None and in_vain and np.array_equal(strands.pair, end.strands.pair):
            if spring >= mesh.pair_spring or not len(strands.pair):
                return end
            # (it may be that strands have gone too deep into each other)
            spring = mesh.pair_spring
            strands = strands._replace(pair_spring=spring)
        if rubs:
            strands = _rubbing(mesh, memory, system, strains, strands, known, firm)
        steps = _STEPS if len(strands.pair) else _FREE
        if mesh.obstructed:
            steps = how.steps
        # (the saddles that a DLO leaves before its strands bear what they do are no saddles)
        begun, check = iterations, how.check and (rests or len(strands.pair) == 0)
        end = step.solved(system._replace(strands=strands), strains,
                          how._replace(steps=steps, check=check))
        iterations, kicks = iterations + end.iterations, kicks + end.kicks
        end = end._replace(iterations=iterations, kicks=kicks, strands=strands)
        moved = float(np.abs(end.positions - positions).max())
        strains, positions = end.strains, end.positions
        borne, off = _borne(lengths, positions, strands)
        lawful = True
        if rubs and len(strands.pair):
            end, lawful = _obeyed(mesh, memory, system, end, strands, borne)
            lawful = lawful and firm == 1.0
        if end.residual < _ROUGH:  # else forces are those of a shape that is none
            system = step.going_on(end)
            if off > max(_SLOWLY * left, _EXACT * length):
                spring = min(_STIFFER * spring, _STIFFEST * mesh.pair_spring)
            known, left, firm = borne, off, min(_FIRMER * firm, 1.0)
        watched = {tuple(pair) for pair in strands.pair.tolist()}
        inside = _pairs(lengths, strains, rays, positions, radii, 0.0)
        if (end.stationary and end.violation <= KEPT * length and off <= _EXACT * length and lawful
                and all(tuple(pair) in watched for pair in inside.tolist())):
            if check or not how.check:
                return end
            rests = True
            continue
        # (among obstacles a search has been as thorough as it can be)
        in_vain = mesh.obstructed and not end.residual < _ROUGH
        creeps = moved < (_STUCK if len(strands.pair) else _CREEPS) * length
        made = iterations - begun if rubs else iterations
        crept = crept + 1 if creeps and made >= 0.5 * steps else 0
        if (iterations >= _MORE * how.steps or not end.residual < np.inf
                or crept > (_PATIENCE if rubs else 0)):
            return end


def _first_spring(mesh: Discretization, known: Forces) -> float:
    """Return the spring in N/m of pairs to begin with; forces that are `known` press, too."""
    if not mesh.obstructed:
        return mesh.pair_spring
    loads = max(float(np.abs(mesh.free.load.pull).sum()), *known.values(), 0.0)
    return min(mesh.pair_spring, loads / (_PRESSED * 2.0 * float(mesh.radii.min())))


def _places(system: Problem, strains: Floats) -> Floats:
    """Return (N + 1, 3) where nodes are, in the world, m."""
    places: Floats = configuration_at(system, strains).positions + system.origin
    return places


def _pairs_at(mesh: Discretization, system: Problem,
              strains: Floats) -> list[tuple[float, float]]:
    """Return distance and sum of radii, m, of the pairs that are in each other."""
    lengths, places, rays = mesh.free.lengths, _places(system, strains), system.rays
    pairs = _pairs(lengths, strains, rays, places, mesh.radii, 0.0)
    return [(float(nearest_points(lengths, rays, places, i, j)[2]), reach)
            for (i, j), reach in zip(pairs.tolist(), _reaches(mesh.radii, pairs).tolist(),
                                     strict=True)]


def _near(lengths: Floats, strains: Floats, rays: Floats, positions: Floats, radii: Floats,
          known: Forces, spring: float) -> Strands:
    """Return the Strands of pairs that are near, with the normal forces that are known."""
    gap = max(_WATCHED * float(radii.max()), _BESIDE * float(lengths.max()))
    pairs = _pairs(lengths, strains, rays, positions, radii, gap)
    forces = np.array([known.get((i, j), 0.0) for i, j in pairs.tolist()])
    return smooth_strands(pairs, forces, _reaches(radii, pairs), radii, rays, spring)


def _rubbing(mesh: Discretization, memory: Memory, system: Problem, strains: Floats,
             strands: Strands, bears: Forces, part: float) -> Strands:
    """Return the Strands with friction, in springs as stiff as a part of what they are.

    `memory` is of the shape before, `bears` has normal forces that limit it.
    """
    before = dict(zip(map(tuple, mesh.pairs_at(memory.strands).tolist()),
                      memory.strands[:, 3:5].tolist(), strict=True))
    pairs = [tuple(pair) for pair in strands.pair.tolist()]
    now, slips, limits = _slips(mesh, memory, system, strains, strands)
    limits = limits * [bears.get(pair, 0.0) for pair in pairs]
    spring = max(mesh.pair_spring, float(limits.max(initial=0.0) / (_GIVES * mesh.radii.min())))
    return strands._replace(
        rub_force=np.array([before.get(pair, (0.0, 0.0)) for pair in pairs]).reshape(-1, 2),
        rub_limit=limits, rub_slip=slips, rub_places=now.positions, rub_frames=now.rotations,
        rub_spring=part * spring if len(memory.frames) else 0.0)


def _slips(mesh: Discretization, memory: Memory, system: Problem, strains: Floats,
           strands: Strands) -> tuple[Configuration, Floats, Floats]:
    """Return the shape, slips (P, 2) of pairs since the shape before, m, and limits by forces."""
    now, count = configuration_at(system, strains), len(strands.pair)
    slips, touched = np.zeros((count, 2)), np.zeros(count)
    # (where nobody knows a shape before, there is no slip, and friction is what it was)
    places, frames = ((np.array(memory.positions), np.array(memory.frames)) if len(memory.frames)
                      else (now.positions, now.rotations))
    put_slips(strands, mesh.free.lengths, now, places, frames, slips, touched)
    return now, slips, mesh.surroundings.self_friction * touched


def _obeyed(mesh: Discretization, memory: Memory, system: Problem, end: Solution,
            strands: Strands, bears: Forces) -> tuple[Solution, bool]:
    """Return a Solution with the friction of its slips, and whether that is what acts."""
    forces = [bears.get((i, j), 0.0) for i, j in strands.pair.tolist()]
    now, slips, limits = _slips(mesh, memory, system, np.array(end.strains), strands)
    acting, lawful = np.zeros_like(slips), np.zeros_like(slips)
    put_friction(strands, mesh.free.lengths, now, acting)
    there = strands._replace(rub_limit=limits * forces, rub_slip=slips, rub_places=now.positions,
                             rub_frames=now.rotations)
    put_friction(there, mesh.free.lengths, now, lawful)
    return (end._replace(strands=there),
            bool(np.abs(lawful - acting).max(initial=0.0) <= _CONE * max(forces, default=0.0)))


def springs_between(mesh: Discretization, gripper: Pose, holds: Holds, strains: Floats,
                    positions: Floats, rub_of: Ints, rubs: Floats) -> Strands:
    """Return the Strands that bear on their springs alone at an instant of a motion.

    Shapes: strains (N, 3), positions (N + 1, 3); pairs that rub (c, 2), and (c, 4) their friction
    there, N, and slip in the step, m.
    """
    rays = rays_behind(gripper, holds, float(mesh.s[-1]))
    pairs = _pairs(mesh.free.lengths, strains, rays, positions, mesh.radii, 0.0)
    known = {(i, j): one for (i, j), one in zip(rub_of.tolist(), rubs.tolist(), strict=True)}
    friction = np.array([known.get((i, j), [0.0] * 4) for i, j in pairs.tolist()]).reshape(-1, 4)
    strands = smooth_strands(pairs, np.zeros(len(pairs)), _reaches(mesh.radii, pairs), mesh.radii,
                             rays, mesh.pair_spring)
    # (in a spring of 0 N/m friction is what it was)
    return strands._replace(rub_force=friction[:, :2], rub_slip=friction[:, 2:],
                            rub_limit=np.linalg.norm(friction[:, :2], axis=1))


def stored_between(mesh: Discretization, strands: Strands, positions: Floats,
                   rubs: Floats) -> float:
    """Return the energy in the springs of `springs_between`, of friction too, J."""
    stretched = [reach - nearest_points(mesh.free.lengths, strands.rays, positions, i, j)[2]
                 for (i, j), reach in zip(strands.pair.tolist(), strands.pair_reach.tolist(),
                                          strict=True)]
    return float(0.5 * mesh.pair_spring * np.square(stretched).sum()
                 + 0.5 * np.square(rubs[:, :2]).sum() / mesh.pair_spring)


def _reaches(radii: Floats, pairs: Ints) -> Floats:
    """Return (P,) the sums of the radii of pairs of strands, m."""
    sums: Floats = radii[np.clip(pairs, 0, radii.size - 1)].sum(axis=1)
    return sums


def _pairs(lengths: Floats, strains: Floats, rays: Floats, positions: Floats, radii: Floats,
           gap: float) -> Ints:
    """Return (P, 2) the pairs nearer than both radii and a gap, m."""
    # (what could be written, and what not, are two types for kernels)
    copied, strained, behind, placed = map(np.array, (lengths, strains, rays, positions))
    found = np.empty((4 * lengths.size, 2), dtype=np.int64)
    count = near_pairs(copied, strained, behind, placed, radii, gap, found)
    if count > len(found):
        found = np.empty((count, 2), dtype=np.int64)
        near_pairs(copied, strained, behind, placed, radii, gap, found)
    return found[:count]


def _borne(lengths: Floats, positions: Floats,
           strands: Strands) -> tuple[Forces, float]:
    """Return the forces of pairs, N, and by how much the springs still bear, m."""
    known, off = {}, 0.0
    for p, (i, j) in enumerate(strands.pair.tolist()):
        distance = nearest_points(lengths, strands.rays, positions, i, j)[2]
        force = float(bears(strands, p, distance))
        off = max(off, abs(force - float(strands.pair_force[p])) / strands.pair_spring)
        if force > 0.0:
            known[i, j] = force
    return known, off
