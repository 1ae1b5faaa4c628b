# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Choosing the discretization that meets an accuracy: mesh graded to the bend, terms as needed."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.bearing import corrected_by
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.foreseen import came_true, expected_within, foreseen
from dlo_planner.direct.history import History
from dlo_planner.direct.indicator import (
    like_before,
    mode_may_be_missed,
    surely_within,
)
from dlo_planner.direct.mesh import even_mesh, graded_mesh, straight_between, with_breaks
from dlo_planner.direct.one_step import How, past_of, step
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import equilibrium, hanging
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze, same

_FIRST_ELEMENTS, _MOST_ELEMENTS = 48, 8192
_MANY = 512  # elements: a DLO whose error is not known with so many is given up
_FIRST_TERMS, _MOST_TERMS = 12, 48
_PER_BEND = 2.5  # elements on (EI / weight per length)^(1/3), over which a soft DLO bends
_RESOLVED = 2e-4  # of the length: an error that is no more than that goes with the mesh
_TURNED = 0.1  # rad: it is another equilibrium
_DEFAULT = 1e-3  # of the length
_SOFT = 27.0      # F L^2 / EI: a DLO that is softer hangs down near the gripper
_LEAST = 0.15     # of that: one that is held at both ends is not as narrow as it is soft
_ENOUGH, _MARGIN = 0.75, 0.5  # parts of the accuracy: what is good, and what is aimed at
_CLEARLY, _RUBBED = 0.7, 0.35  # the same, where the error is known to first order; with friction


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
    """Return the Shape whose error estimate is within an accuracy, and the number of kicks.

    Starts on the mesh of `initial` (a Shape or None), so that a motion pays for grading once.
    A shape that misses the accuracy on the largest mesh says so: `converged` is False.

    Parameters
    ----------
    wanted : Wanted
    initial : Shape or None
    how : How
        As of `one_step.step`, by Newton's method.
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
    coarse = told = None
    while True:
        if told is not None:
            shape, kicked = hanging(told.mesh, gripper, told.strains)
        elif coarse is not None and far_end is None and _resolved(coarse):
            shape, kicked = hanging(discretization, gripper, _smooth_start(discretization, coarse))
        else:
            shape, kicked = step(discretization, gripper, initial, how)
        kicks += kicked
        if shape.converged and shape.hinge is not None:  # on finer meshes it is another shape
            return replace(shape, converged=False), kicks
        if not shape.converged or surely_within(shape, accuracy) or not _mode_is_missed(
                shape, accuracy) and (
                    not kicked and came_true(shape, told, _ENOUGH * accuracy)
                    or like_before(shape, initial, accuracy)
                    or _clearly_within(discretization, shape, accuracy)
                    or _near_enough(shape, accuracy)):
            return shape, kicks
        told = foreseen(shape, accuracy) if fine == 'local' and far_end is None else None
        better = told.mesh if told else _refined(discretization, fine, shape, accuracy)
        if better is None:
            return replace(shape, converged=shape.error_estimate <= accuracy), kicks
        discretization, coarse = better, shape
        if anyhow:
            initial = shape  # a better start; where the way counts, the step is made again


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


def _clearly_within(discretization: Discretization, shape: Shape, accuracy: float) -> bool:
    """Whether one step on the finer mesh tells that a Shape on this one is within `accuracy` (m).

    What friction did on the way to it would be another on that mesh: over 789 random steps the
    estimate was twice as large, or more, three times.
    """
    if not shape.contacts:
        return False
    rubbed = any(contact.friction.any() for contact in shape.contacts)
    left = past_of(discretization, shape, None)
    return corrected_by(discretization, shape, left) <= accuracy * (_RUBBED if rubbed else _CLEARLY)


def within(shape: Shape, accuracy: float) -> bool:
    """Whether a Shape's error is below `accuracy` (m): at a glance, or as near as can be told."""
    return surely_within(shape, accuracy) or _near_enough(shape, accuracy)


def _near_enough(shape: Shape, accuracy: float) -> bool:
    """Whether a Shape's error is below a part of `accuracy` (m), as expected or as estimated."""
    told = expected_within(shape, _ENOUGH * accuracy)
    return shape.error_estimate <= _ENOUGH * accuracy if told is None else told


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
                       initial: Shape | None, history: History | None) -> Discretization:
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
