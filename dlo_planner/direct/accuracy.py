# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a shape may be off, and the discretization on which it is within an accuracy.

Whether an accuracy that was asked for is kept, `Shape.error_estimate` alone says (`judged`). Meshes
are chosen by less on the way there: `basis.truncation_error` bounds the error of most shapes
(`surely_within`), and its leading order tells which mesh will be fine enough (`foreseen`).

Beside `truncation_error` the estimate of random DLOs that hang freely, are held at both ends, or
touch something, was below what is taken as certain here. Of a DLO that has yielded it tells
nothing, nor of point loads, more than half a turn of natural twist, and what varies along the
length.

A permanent set is as exact as the mesh on which it was made, and stays there.
"""

from dataclasses import replace
from math import ceil, sqrt
from typing import Any

import numpy as np

from dlo_planner.direct.discretization import (
    Discretization,
    Memory,
    even_mesh,
    graded_mesh,
    nodes_at,
    with_breaks,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import StepInputs, corrected_by, equilibrium, past_of, step
from dlo_planner.geometry.basis import truncation_error
from dlo_planner.minimize.expected_error import discretization_errors, resampled_means
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import freeze, same

_FIRST_ELEMENTS, _MOST_ELEMENTS = 48, 8192
_MANY = 512  # elements: a DLO whose error is not known with so many is given up
_FIRST_TERMS, _MOST_TERMS = 12, 48
_PER_BEND = 2.5  # elements on (EI / weight per length)^(1/3), over which a soft DLO bends
_FORESEEN = 2e-3  # the same, of what is expected on a finer mesh
_DOUBTFUL = 2.0  # times the accuracy: what is expected to be off by more is off
_TURNED = 0.1  # rad: it is another equilibrium
_DEFAULT = 1e-3  # of the length
_SOFT = 27.0      # F L^2 / EI: a DLO that is softer hangs down near the gripper
_LEAST = 0.15     # of that: one that is held at both ends is not as narrow as it is soft
_OF_FIRST_SET = 0.25  # part of the accuracy: what is wanted where a DLO begins to yield
_ENOUGH, _MARGIN = 0.75, 0.5  # parts of the accuracy: what is good, and what is aimed at
_AIM = 0.6         # the same, where the error is foreseen
_CLEARLY, _RUBBED = 0.7, 0.35  # the same, of one step on a finer mesh; with friction
_FINER = 1.2       # times as many elements at least
_FARTHEST = 20     # and at most: so far one shape tells what another mesh will do
_FREE, _HELD, _TOUCHING = 4.0, 1.5, 2.5  # times `truncation_error`: less
_STABLE = 0.1    # a shape that is less stable magnifies errors
_BEARS = 5e-4    # of the length: below, where it bears on an obstacle may be off by more than bends


def accurate_equilibrium(first: Discretization, fine: str, wanted: float, gripper: Pose,
                         initial: Shape | None, how: StepInputs) -> Shape:
    """Return a Shape on a mesh for the accuracy `wanted`, m: `first`, or better ones in `fine`.

    Starts on the mesh of `initial` (a Shape or None), so that a motion pays for grading once.
    A shape that misses the accuracy on the largest mesh says so: `converged` is False. What is in
    contact may miss it on any: that is for `judged` to say, at the end of a step.
    """
    accuracy, far_end = wanted, how.far_end
    mesh = mesh_to_begin_with(first, fine, accuracy, initial, how.memory)
    if far_end is not None:
        from dlo_planner.direct.taut import bent_mesh  # noqa: PLC0415  (SciPy: a free DLO needs none)
        if first.obstructed and initial is None:
            mesh = _fine_enough_to_bend(mesh, fine)
        mesh = bent_mesh(mesh, gripper, far_end, fine)
    begin, start, kicks = initial, None, 0
    while True:
        shape = step(mesh, gripper, begin, how, start)
        kicks += shape.state.kicks
        if kicks > shape.state.kicks:  # those on the meshes before count as well
            shape = replace(shape, state=replace(shape.state, kicks=kicks))
        if shape.converged and shape.hinge is not None:  # on finer meshes it is another shape
            return replace(shape, converged=False)
        if not shape.converged:
            return shape
        if shape.dissipated:
            lasts = _made_with_a_set(shape)
            if lasts and (fine == 'local' or initial is not None and mesh == initial.state.mesh):
                return shape
            accuracy = (1.0 if lasts else _OF_FIRST_SET) * wanted
        # the first mesh is hardly ever fine enough: then nothing else is computed on it
        new = mesh is first and (initial is None or initial.state.mesh != mesh)
        better = None
        if new and fine == 'local' and not surely_within(shape, accuracy):
            better = foreseen(shape, accuracy, _DOUBTFUL)
        if better is None:
            kinked = shape.dissipated and mesh.basis != fine  # no series follows where it yields
            if not kinked and fine_enough(shape, accuracy):
                return shape
            better = foreseen(shape, accuracy) if fine == 'local' else None
        if better is not None:
            mesh, start = better
        else:
            finer = _refined(mesh, fine, shape, accuracy)
            if finer is None:
                return judged(shape, wanted)
            mesh, start = finer, None
        if not _way_counts(shape, initial):
            begin = shape  # a better start; else the step is made again


def _made_with_a_set(shape: Shape) -> bool:
    """Whether a DLO was bent for good before the step that made a Shape."""
    return shape.state.before is not None and shape.state.before.has_set


def _way_counts(shape: Shape, initial: Shape | None) -> bool:
    """Whether a Shape depends on the way that led to it, and not only where that ended."""
    around, held = shape.state.made_on.surroundings, shape.far_end is not None
    if shape.state.culled:
        return held and initial is not None
    rubs = any(one.friction for one in around.obstacles)
    return bool(around.rod.yields
                or (around.obstacles or held) and (initial is not None or rubs))


def fine_enough(shape: Shape, accuracy: float) -> bool:
    """Return whether the mesh of a Shape is fine enough for an accuracy, m."""
    if surely_within(shape, accuracy):
        return True
    return not _mode_is_missed(shape, accuracy) and (
        _clearly_within(shape, accuracy) or shape.error_estimate <= _ENOUGH * accuracy)


def judged(shape: Shape, accuracy: float) -> Shape:
    """Return a Shape as it is if its error is at most `accuracy` (m), else not `converged`."""
    if not shape.converged or shape.error_estimate <= accuracy:
        return shape
    return replace(shape, converged=False)


def _clearly_within(shape: Shape, accuracy: float) -> bool:
    """Whether a mesh is fine enough for a DLO in contact, by one step on one that is finer.

    That takes all contacts as they are. Another set of them, or what friction did on the way, may
    be further off: that is no matter of the mesh, and `judged` looks at it.
    """
    if not shape.contacts:
        return False
    mesh = shape.state.made_on
    rubbed = any(contact.friction.any() for contact in shape.contacts)
    part = _RUBBED if rubbed else _CLEARLY
    return corrected_by(mesh, shape, past_of(mesh, shape, None)) <= part * accuracy


def _mode_is_missed(shape: Shape, accuracy: float) -> bool:
    """Whether a local mesh shows that a Shape, which its series makes stable, falls aside."""
    mesh = shape.state.made_on
    if not mode_may_be_missed(shape) or mesh.yields and not shape.state.culled:
        return False  # what has yielded would yield again
    there = _freed(shape)
    moved = np.linalg.norm(there.positions - shape.positions, axis=1).max()
    turned = np.abs(there.frames - shape.frames).max()  # a straight DLO may have shed a turn
    return not there.converged or moved > accuracy or turned > _TURNED


def _freed(shape: Shape) -> Shape:
    """Return the equilibrium beside a Shape on its mesh without the series."""
    return equilibrium(shape.state.made_on.local, shape.gripper, shape.element_strains,
                       shape.state.history, shape.far_end, culled=shape.state.culled)


def _fine_enough_to_bend(mesh: Discretization, fine: str) -> Discretization:
    """Return a Discretization whose elements can bend round obstacles under the DLO's weight."""
    weight = np.linalg.norm(mesh.load)
    length, around = mesh.s[-1], mesh.surroundings
    if weight == 0.0:
        return mesh
    bent = (min(around.rod.stiffness[1:]) * length / weight) ** (1 / 3)
    wanted = min(int(np.ceil(_PER_BEND * length / bent)), _MANY)
    if wanted < mesh.s.size:
        return mesh
    return Discretization(around, even_mesh(length, wanted, around.breaks), fine, _FIRST_TERMS)


def default_accuracy(mesh: Discretization) -> float:
    """Return the accuracy (m) of a DLO of which none is named.

    A soft one hangs down within a part of its length, of the size (EI L / F)^(1/3) by its loads F.
    Errors are by the square of elements as long as that part is: so is the accuracy. Among
    obstacles, which decide where it is bent, it is that of any other.
    """
    if mesh.surroundings.obstacles:
        return _DEFAULT * float(mesh.s[-1])
    system, length = mesh.free, mesh.s[-1]
    force = float(np.sum(np.linalg.norm(system.load.pull, axis=1)))
    softness = force * length**2 / np.min(system.stiffness[:, 1:])
    part = (_SOFT / max(softness, _SOFT)) ** (2 / 3)
    return _DEFAULT * float(length * max(part, _LEAST))


def first_mesh(surroundings: Surroundings, basis: str) -> Discretization:
    """Return the Discretization with which the search for an accuracy begins."""
    s = even_mesh(surroundings.rod.length, _FIRST_ELEMENTS, surroundings.breaks)
    return Discretization(surroundings, s, basis, _FIRST_TERMS)


def mesh_to_begin_with(first: Discretization, fine: str, accuracy: float | None,
                       initial: Shape | None, memory: Memory | None) -> Discretization:
    """Return the Discretization to begin with: in these surroundings, on the mesh of `initial`.

    A permanent set stays on its mesh.
    """
    if accuracy is None:
        return first
    around, known = first.surroundings, None if initial is None else initial.state.mesh
    if memory is not None and (known is None or not same(known.rod, around.rod)):
        initial = known = None  # the set is the simulator's
    if initial is not None and known is not None and surely_within(initial, accuracy, first):
        return first
    past = memory if initial is None else initial.state.history
    s = initial.s if initial is not None else None if memory is None else memory.s
    if (past is not None and past.has_set
            and (known is None or known.basis not in (first.basis, fine))):
        return Discretization(around, with_breaks(past.s, around.breaks), fine, first.n_terms)
    if s is None or known is not None and known.basis not in (first.basis, fine):
        return first
    if known is None:  # of a shape from a file, or a set
        if fine != 'local' or s.size < first.s.size or np.array_equal(s, first.s):
            return first
        return Discretization(around, with_breaks(s, around.breaks), fine, 0)
    if same(known.surroundings, around):
        return known
    s = with_breaks(np.append(s[:-1], around.rod.length), around.breaks)
    return Discretization(around, s, known.basis, known.n_terms)


def _refined(mesh: Discretization, fine: str, shape: Shape,
             accuracy: float) -> Discretization | None:
    """Return a finer Discretization, or None at the limits."""
    around, s = mesh.surroundings, mesh.s
    elements, terms = len(shape.element_strains), mesh.n_terms
    bent = shape.element_strains - mesh.natural
    if mesh.basis != fine:
        s = graded_mesh(s, bent, elements, around.breaks)
        return Discretization(around, s, fine, _FIRST_TERMS)
    from_mesh = shape.error_estimate
    if elements >= _MANY and not np.isfinite(from_mesh):
        return None
    if fine != 'local':
        from_mesh = _freed(shape).error_estimate
        if shape.error_estimate > 1.5 * from_mesh or from_mesh < 0.3 * _MARGIN * accuracy:
            terms = min(terms + max(2, terms // 4), _MOST_TERMS)
    if from_mesh > 0.8 * _MARGIN * accuracy:
        growth = np.clip(np.sqrt(from_mesh / (0.5 * _MARGIN * accuracy)), 1.2, 2.5)
        wanted = min(int(np.ceil(growth * elements)), _MOST_ELEMENTS)
        if not _made_with_a_set(shape):
            s = graded_mesh(s, bent, wanted, around.breaks)
    if terms == mesh.n_terms and s.size == mesh.s.size:
        return None
    return Discretization(around, s, fine, terms)


def surely_within(shape: Shape, accuracy: float, mesh: Discretization | None = None) -> bool:
    """Return whether a Shape is certain to be within `accuracy` (m), without a further solution."""
    here = shape.state.made_on if mesh is None else mesh
    if (shape.dissipated or not here.bounded_by_truncation
            or shape.contacts and accuracy < _BEARS * shape.s[-1]
            or shape.stability < _STABLE and (shape.far_end is None or here.basis != 'local')):
        return False
    strains, system = shape.element_strains, here.free
    if not here.has_nodes(shape.s):
        freeze(strains := here.strains_from(shape.s, strains))  # as those of a Shape are
    times = _TOUCHING if shape.contacts else _FREE if shape.far_end is None else _HELD
    return bool(times * truncation_error(system.lengths, strains, system.natural, system.scale,
                                         system.basis) <= accuracy)


def hanging_surely_within(bounded: bool | Bools, stability: np.ndarray, truncated: np.ndarray,
                          accuracy: float | Floats) -> Bools:
    """Return (n,) what `surely_within` says of DLOs that hang freely; stability, truncated (n,)."""
    return (stability >= _STABLE) & (_FREE * truncated <= accuracy) & bounded


def mode_may_be_missed(shape: Shape) -> bool:
    """Return whether a Shape may be unstable in a way that its series cannot show.

    A series that is short may well follow the shape and still not the mode in which it falls: ten
    Chebyshev terms make a straight rod under tension T L^2 = 50 EI bear 1 % too much torsion.
    """
    return bool(shape.state.made_on.basis != 'local' and shape.stability < _STABLE)


def foreseen(shape: Shape, accuracy: float,
             least: float = 0.0) -> tuple[Discretization, Floats] | None:
    """Return the mesh on which a Shape will be within an `accuracy` (m), and its strains there.

    None where its error does not come from arcs and loads alone, it is off by `least` accuracies or
    less, or no mesh is fine enough.
    """
    known, elements = shape.state.made_on, shape.element_strains.shape[0]
    around = known.surroundings
    if (not shape.state.culled or shape.far_end is not None or known.basis != 'local'
            or known.rod.varies or callable(around.load) or not 2 < elements < _MOST_ELEMENTS):
        return None
    mass: Any = known.rod.mass_per_length  # nothing varies
    load: Any = 0.0 if around.load is None else around.load
    own, off, shares, one, there = discretization_errors(
        known.free, shape.gripper.rotation, shape.element_strains, -mass * around.gravity - load)
    if not least * accuracy < own <= _FORESEEN * shape.s[-1]:
        return None
    most = min(_FARTHEST * elements, _MOST_ELEMENTS)
    wanted = min(max(ceil(sqrt(one / (_AIM * accuracy))), ceil(_FINER * elements)), most)
    breaks = around.breaks
    points = [s for s, _ in known.rod.point_masses]
    points += [one.s for one in around.dead_loads if one.s is not None]
    if points:
        breaks = np.union1d(breaks, points)
        breaks = breaks[(breaks > 0) & (breaks < known.s[-1])]
    s = nodes_at(known.s, shares, wanted, breaks)
    strains = resampled_means(known.s, shape.element_strains - off + there / wanted**2, s)
    return Discretization(around, s, 'local', 0), strains
