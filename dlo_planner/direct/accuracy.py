# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a shape may be off, and the discretization on which it is within an accuracy.

Whether a shape is within an accuracy is told by `basis.truncation_error` where that bounds the
error, by its leading order where that is known (`minimize.expected_error`), by the error of the
shape before (`State.error_ratio`), else by `Shape.error_estimate`: by what shapes are, not by what
somebody has read before.

`python test/random_estimates.py` prints how large the estimate is beside `truncation_error`, for
random DLOs that hang freely, are held at both ends, or touch something: below what is taken as
certain here. For DLOs that may yield it was 0.5 times (97) as long as they have not, 4.1 times (33)
where they had. That chooses their meshes, on which a set stays: on another one it is averaged, and
nothing tells of that error. Whether one that has yielded keeps an accuracy that was asked for,
`judged` decides by the estimate. Of point loads, more than half a turn of natural twist, and what
varies along the length it says nothing. The same script prints how large the estimate is beside
what is expected of a DLO that hangs freely.
"""

from dataclasses import replace
from math import ceil, sqrt
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.memory import Memory
from dlo_planner.direct.mesh import (
    even_mesh,
    graded_mesh,
    nodes_at,
    straight_between,
    with_breaks,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import equilibrium, hanging
from dlo_planner.direct.step import How, corrected_by, past_of, step
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.geometry.basis import truncation_error
from dlo_planner.minimize.expected_error import discretization_errors, resampled_means
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Constant, freeze, same

_FIRST_ELEMENTS, _MOST_ELEMENTS = 48, 8192
_MANY = 512  # elements: a DLO whose error is not known with so many is given up
_FIRST_TERMS, _MOST_TERMS = 12, 48
_PER_BEND = 2.5  # elements on (EI / weight per length)^(1/3), over which a soft DLO bends
_RESOLVED = 2e-4  # of the length: an error below it goes with the mesh, as its leading order does
_TOLD_FINER = 2e-3  # the same, of what is expected on a finer mesh
_DOUBTFUL = 3.0  # times the accuracy: what is expected to be off by more is off
_TURNED = 0.1  # rad: it is another equilibrium
_DEFAULT = 1e-3  # of the length
_SOFT = 27.0      # F L^2 / EI: a DLO that is softer hangs down near the gripper
_LEAST = 0.15     # of that: one that is held at both ends is not as narrow as it is soft
_ENOUGH, _MARGIN = 0.75, 0.5  # parts of the accuracy: what is good, and what is aimed at
_AIM = 0.6         # the same, where the error is foreseen
_CLEARLY, _RUBBED = 0.7, 0.35  # the same, of one step on a finer mesh; with friction
_FINER = 1.2       # times as many elements at least
_FARTHEST = 20     # and at most: so far one shape tells what another mesh will do
_FREE, _HELD, _TOUCHING, _YIELDED = 4.0, 1.5, 2.5, 8.0  # times `truncation_error`: less
_STABLE = 0.1    # a shape that is less stable magnifies errors
_LIKE = 3.0      # times what the shape before lets expect: the estimate is below
_BEARS = 5e-4    # of the length: below, where it bears on an obstacle may be off by more than bends


class Wanted(NamedTuple):
    """Which meshes an accuracy chooses from.

    Attributes
    ----------
    first : Discretization
        The one to begin with where there is no better one.
    fine : str
        Basis of better ones.
    accuracy : float
        In m.
    """

    first: Discretization
    fine: str
    accuracy: float


def accurate_equilibrium(wanted: Wanted, gripper: Pose, initial: Shape | None,
                         how: How) -> tuple[Shape, int]:
    """Return a Shape on a mesh for an accuracy, and the number of kicks.

    Starts on the mesh of `initial` (a Shape or None), so that a motion pays for grading once.
    A shape that misses the accuracy on the largest mesh says so: `converged` is False. What is in
    contact may miss it on any: that is for `judged` to say, at the end of a step.
    """
    (first, fine, accuracy), history, far_end = wanted, how.history, how.far_end
    discretization = mesh_to_begin_with(first, fine, accuracy, initial, history)
    around, kicks = first.surroundings, 0
    if far_end is not None and around.obstacles and initial is None:
        discretization = _fine_enough(discretization, fine)
    if far_end is not None:
        from dlo_planner.direct.taut import bent_mesh  # noqa: PLC0415  (SciPy: a free DLO needs none)
        discretization = bent_mesh(discretization, gripper, far_end, fine)
    anyhow = not around.rod.yields and (
        not around.obstacles and far_end is None
        or initial is None and not any(one.friction for one in around.obstacles))
    coarse = start = None
    while True:
        if start is not None:
            shape, kicked = hanging(discretization, gripper, start)
        elif coarse is not None and far_end is None and _resolved(coarse):
            shape, kicked = hanging(discretization, gripper, _smooth_start(discretization, coarse))
        else:
            shape, kicked = step(discretization, gripper, initial, how)
        kicks += kicked
        if shape.converged and shape.hinge is not None:  # on finer meshes it is another shape
            return replace(shape, converged=False), kicks
        if not shape.converged or surely_within(shape, accuracy):
            return shape, kicks
        if not _mode_is_missed(shape, accuracy):
            if _goes_on(shape, initial, accuracy) or _clearly_within(shape, accuracy):
                return shape, kicks
            expected = _expected_within(shape, accuracy)
            if expected is None and shape.error_estimate <= _ENOUGH * accuracy:
                return _with_ratio(shape), kicks
            if expected:
                return shape, kicks
        finer = foreseen(shape, accuracy) if fine == 'local' and far_end is None else None
        better, start = finer or (_refined(discretization, fine, shape, accuracy), None)
        if better is None:
            return judged(shape, accuracy), kicks
        discretization, coarse = better, shape
        if anyhow:
            initial = shape  # a better start; where the way counts, the step is made again


def _clearly_within(shape: Shape, accuracy: float) -> bool:
    """Whether a mesh is fine enough for a DLO in contact, by one step on one that is finer.

    That takes all contacts as they are. Another set of them, or what friction did on the way, may
    be further off: that is no matter of the mesh, and `judged` looks at it.
    """
    if not shape.contacts:
        return False
    discretization = shape.state.made_on
    rubbed = any(contact.friction.any() for contact in shape.contacts)
    left = past_of(discretization, shape, None)
    return corrected_by(discretization, shape, left) <= accuracy * (_RUBBED if rubbed else _CLEARLY)


def judged(shape: Shape, accuracy: float) -> Shape:
    """Return a Shape as it is if its error is at most `accuracy` (m), else not `converged`."""
    if not shape.converged:
        return shape
    yielded = shape.state.made_on.rod.yields and shape.dissipated
    if not yielded and surely_within(shape, accuracy) or shape.error_estimate <= accuracy:
        return shape
    return replace(shape, converged=False)


def _goes_on(shape: Shape, before: Shape | None, accuracy: float) -> bool:
    """Whether a Shape is within an accuracy, judged by the one before it on the same mesh.

    Where the error of that one is known, its ratio to `truncation_error`, three times as large,
    bounds the error here: at most every second shape of a motion needs a further solution.
    """
    ratio = None if before is None else before.state.error_ratio
    if (before is None or ratio is None or shape.jumped or shape.contacts or before.contacts
            or before.state.mesh is not shape.state.mesh
            or min(shape.stability, before.stability) < _STABLE):
        return False
    truncated = _truncation(shape.state.made_on, shape.element_strains)
    return bool(_LIKE * ratio * truncated <= accuracy)


def _with_ratio(shape: Shape) -> Shape:
    """Return a Shape whose state tells how large its error is beside its `truncation_error`."""
    truncated = _truncation(shape.state.made_on, shape.element_strains)
    if shape.contacts or not truncated > 0.0:
        return shape
    error = shape.error_estimate
    return replace(shape, state=replace(shape.state, estimate=Constant(error),
                                        error_ratio=error / truncated))


def within(shape: Shape, accuracy: float) -> bool:
    """Return whether the error of a Shape from a simulator is below `accuracy` (m)."""
    if surely_within(shape, accuracy):
        return True
    expected = _expected_within(shape, accuracy)
    return shape.error_estimate <= _ENOUGH * accuracy if expected is None else expected


def _expected_within(shape: Shape, accuracy: float) -> bool | None:
    """Return whether the leading order of the error is below `accuracy`; None: it does not tell."""
    expected = float(_foresee(shape)[0])
    if expected <= _RESOLVED * shape.s[-1]:
        # what acts inside an element bends that otherwise than its share on both nodes
        points = _points(shape.state.made_on)
        told = shape.stability >= _STABLE and (not points.size or np.isin(points, shape.s).all())
        return expected <= _ENOUGH * accuracy if told else None
    return False if _DOUBTFUL * _ENOUGH * accuracy < expected < np.inf else None


def _mode_is_missed(shape: Shape, accuracy: float) -> bool:
    """Whether a local mesh shows that a Shape, which its series makes stable, falls aside."""
    mesh = shape.state.made_on
    if not mode_may_be_missed(shape) or mesh.rod.yields:  # what has yielded would yield again
        return False
    free = Discretization(mesh.surroundings, mesh.s, 'local', 0)
    there = equilibrium(free, shape.gripper, shape.element_strains, 'newton', shape.state.history,
                        shape.far_end)[0]
    moved = np.linalg.norm(there.positions - shape.positions, axis=1).max()
    turned = np.abs(there.frames - shape.frames).max()  # a straight DLO may have shed a turn
    return not there.converged or moved > accuracy or turned > _TURNED


def _fine_enough(discretization: Discretization, fine: str) -> Discretization:
    """Return a Discretization whose elements can bend round obstacles under the DLO's weight."""
    weight = np.linalg.norm(discretization.load)
    length, around = discretization.s[-1], discretization.surroundings
    if weight == 0.0:
        return discretization
    bent = (min(around.rod.stiffness[1:]) * length / weight) ** (1 / 3)
    wanted = min(int(np.ceil(_PER_BEND * length / bent)), _MANY)
    if wanted < discretization.s.size:
        return discretization
    return Discretization(around, even_mesh(length, wanted, around.breaks), fine, _FIRST_TERMS)


def default_accuracy(discretization: Discretization) -> float:
    """Return the accuracy (m) of a DLO of which none is named.

    A soft one hangs down within a part of its length, of the size (EI L / F)^(1/3) by its loads F.
    Errors are by the square of elements as long as that part is: so is the accuracy. Among
    obstacles, which decide where it is bent, it is that of any other.
    """
    if discretization.surroundings.obstacles:
        return _DEFAULT * float(discretization.s[-1])
    system, length = discretization.static, discretization.s[-1]
    force = float(np.sum(np.linalg.norm(system.pull, axis=1)))
    softness = force * length**2 / np.min(system.stiffness[:, 1:])
    part = (_SOFT / max(softness, _SOFT)) ** (2 / 3)
    return _DEFAULT * float(length * max(part, _LEAST))


def first_mesh(surroundings: Surroundings, basis: str) -> Discretization:
    """Return the Discretization with which the search for an accuracy begins."""
    s = even_mesh(surroundings.rod.length, _FIRST_ELEMENTS, surroundings.breaks)
    return Discretization(surroundings, s, basis, _FIRST_TERMS)


def mesh_to_begin_with(first: Discretization, fine: str, accuracy: float | None,
                       initial: Shape | None, history: Memory | None) -> Discretization:
    """Return the Discretization to begin with: in these surroundings, on the mesh of `initial`.

    A permanent set stays on its mesh: on another one it would be averaged.
    """
    if accuracy is None:
        return first
    around, known = first.surroundings, None if initial is None else initial.state.mesh
    if history is not None and (known is None or not same(known.rod, around.rod)):
        initial = known = None  # the set is the simulator's
    if initial is not None and known is not None and surely_within(initial, accuracy, first):
        return first
    s = initial.s if initial is not None else None if history is None else history.s
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


def _refined(discretization: Discretization, fine: str, shape: Shape,
             accuracy: float) -> Discretization | None:
    """Return a finer Discretization, or None at the limits."""
    around, s = discretization.surroundings, discretization.s
    elements, terms = len(shape.element_strains), discretization.n_terms
    bent = shape.element_strains - discretization.natural
    if discretization.basis != fine:
        s = graded_mesh(s, bent, elements, around.breaks)
        return Discretization(around, s, fine, _FIRST_TERMS)
    from_mesh = shape.error_estimate
    if elements >= _MANY and not np.isfinite(from_mesh):
        return None
    if fine != 'local':
        free = Discretization(around, s, 'local', 0)
        from_mesh = equilibrium(free, shape.gripper, shape.element_strains, 'newton',
                                shape.state.history, shape.far_end)[0].error_estimate
        if shape.error_estimate > 1.5 * from_mesh or from_mesh < 0.3 * _MARGIN * accuracy:
            terms = min(terms + max(2, terms // 4), _MOST_TERMS)
    if from_mesh > 0.8 * _MARGIN * accuracy:
        growth = np.clip(np.sqrt(from_mesh / (0.5 * _MARGIN * accuracy)), 1.2, 2.5)
        wanted = min(int(np.ceil(growth * elements)), _MOST_ELEMENTS)
        s = graded_mesh(s, bent, wanted, around.breaks)
    if terms == discretization.n_terms and s.size == discretization.s.size:
        return None
    return Discretization(around, s, fine, terms)


def _resolved(shape: Shape) -> bool:
    """Whether the elements of a DLO that hangs freely follow its bend, if roughly."""
    return (shape.state.made_on.hangs
            and shape.error_estimate < _RESOLVED * shape.state.made_on.s[-1])


def _smooth_start(discretization: Discretization, shape: Shape) -> Floats:
    """Return (N, 3), read-only: strains whose moments lie straight between those of a Shape.

    Moments do not jump where stiffness and natural strains do: a search on a finer mesh begins
    nearer to its end than with steps.
    """
    known = shape.state.made_on
    moments = known.static.stiffness * (shape.element_strains - known.natural)
    strains = discretization.natural + (straight_between(known.s, moments, discretization.s)
                                        / discretization.static.stiffness)
    freeze(strains)
    result: Floats = strains
    return result


def surely_within(shape: Shape, accuracy: float, mesh: Discretization | None = None) -> bool:
    """Return whether a Shape is certain to be within `accuracy` (m), without a further solution."""
    here = shape.state.made_on if mesh is None else mesh
    times = _times(shape, here.rod)
    if (times is None or not here.told_by_truncation
            or shape.contacts and accuracy < _BEARS * shape.s[-1]
            or shape.stability < _STABLE and (shape.far_end is None or here.basis != 'local')):
        return False
    if here is shape.state.mesh:
        return bool(times * _truncation(here, shape.element_strains) <= accuracy)
    strains = here.strains_from(shape.s, shape.element_strains)
    return bool(times * _truncation(here, strains) <= accuracy)


def hanging_surely_within(told: bool | Bools, stability: np.ndarray, truncated: np.ndarray,
                          accuracy: float | Floats) -> Bools:
    """Return (n,) what `surely_within` says of DLOs that hang freely.

    Shapes: stability (n,), truncated (n,).
    """
    return (stability >= _STABLE) & (_FREE * truncated <= accuracy) & told


def mode_may_be_missed(shape: Shape) -> bool:
    """Return whether a Shape may be unstable in a way that its series cannot show.

    A series that is short may well follow the shape and still not the mode in which it falls: ten
    Chebyshev terms make a straight rod under tension T L^2 = 50 EI bear 1 % too much torsion.
    """
    return bool(shape.state.made_on.basis != 'local' and shape.stability < _STABLE)


def _truncation(mesh: Discretization, strains: Floats) -> float:
    system = mesh.static
    freeze(strains)  # as those of a Shape are
    result: float = truncation_error(system.lengths, strains, system.natural, system.scale,
                                     system.basis)
    return result


def _times(shape: Shape, rod: Rod) -> float | None:
    """Return times how many `truncation_error` the error of a Shape surely is below, or None."""
    if rod.yields and shape.dissipated:
        return None if rod.section_model == 'ideal' else _YIELDED
    if shape.contacts:
        return _TOUCHING
    return _FREE if shape.far_end is None else _HELD


def _told(shape: Shape) -> bool:
    """Whether the error of a Shape comes from arcs and loads alone, and not from what varies."""
    mesh = shape.state.made_on
    return bool(mesh.hangs and shape.far_end is None and mesh.basis == 'local'
                and not mesh.rod.varies and not callable(mesh.surroundings.load)
                and shape.element_strains.shape[0] > 2)


def _points(mesh: Discretization) -> Floats:
    """Return (n,) arc lengths of point masses and loads, m."""
    loads = [one.s for one in mesh.surroundings.point_loads if one.s is not None]
    return np.array([s for s, _ in mesh.rod.point_masses] + loads)


def _foresee(shape: Shape) -> Any:
    """Return what `discretization_errors` does of a Shape; (infinity,) where that is not told."""
    if not _told(shape):
        return (np.inf,)
    mesh = shape.state.made_on
    around = mesh.surroundings
    mass: Any = around.rod.mass_per_length  # nothing varies
    load: Any = np.zeros(3) if around.load is None else around.load
    spread = -mass * around.gravity - load
    return discretization_errors(mesh.static, shape.gripper.rotation, shape.element_strains, spread)


def foreseen(shape: Shape, accuracy: float) -> tuple[Discretization, Floats] | None:
    """Return the mesh on which a Shape will be within an `accuracy` (m), and its strains there.

    None where that is not told, or no mesh is fine enough.
    """
    known, elements = shape.state.made_on, shape.element_strains.shape[0]
    own, *rest = _foresee(shape)
    if not own <= _TOLD_FINER * shape.s[-1] or elements >= _MOST_ELEMENTS:
        return None
    off, shares, one, there = rest
    most = min(_FARTHEST * elements, _MOST_ELEMENTS)
    wanted = min(max(ceil(sqrt(one / (_AIM * accuracy))), ceil(_FINER * elements)), most)
    breaks, points = known.surroundings.breaks, _points(known)
    if points.size:
        breaks = np.union1d(breaks, points)
        breaks = breaks[(breaks > 0) & (breaks < known.s[-1])]
    s = nodes_at(known.s, shares, wanted, breaks)
    strains = np.empty((s.size - 1, 3))
    resampled_means(known.s, shape.element_strains - off + there / wanted**2, s, strains)
    freeze(strains)
    return Discretization(known.surroundings, s, 'local', 0), strains
