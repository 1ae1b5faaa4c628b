"""Choosing the discretisation that meets an accuracy: mesh graded to the bend, terms as needed."""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.approach import brought
from dlo_planner.direct.described import described_equilibrium
from dlo_planner.direct.discretisation import Discretisation
from dlo_planner.direct.statics import equilibrium
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import same

_FIRST_ELEMENTS, _MOST_ELEMENTS = 48, 8192
_FIRST_TERMS, _MOST_TERMS = 12, 48
_MARGIN = 0.5  # the estimate has to stay below this part of the accuracy


def step(discretisation, gripper, initial, history, far_end, method='newton',
         unknowns='components'):
    """Return the Shape that follows `initial` (a Shape or None) on a mesh, and the kicks.

    Args:
        initial: of this DLO, then its past counts, or of any other, then it is only a start
        history: History that the DLO starts with if `initial` is none of its own
        method, unknowns: as `method` and `strains` of `DirectSimulator`
    """
    past = past_of(discretisation, initial, history)
    if initial is None:
        strains = discretisation.stress_free(past)
    else:
        strains = discretisation.strains_from(initial.s, initial.element_strains)
    if unknowns == 'paper':
        return described_equilibrium(discretisation, gripper, strains, method, past), 0
    gripper = held_by(discretisation.surroundings, gripper, initial)
    gripper, strains, past, clear = brought(discretisation, initial, strains, gripper, far_end,
                                            past)
    shape, kicks = equilibrium(discretisation, gripper, strains, method, past, far_end)
    return (shape if clear else replace(shape, converged=False, jumped=True)), kicks


def held_by(surroundings, gripper, initial):
    """Return the Pose in which the gripper holds the DLO of `initial` (a Shape or None).

    A pinned DLO does not turn with its gripper.
    """
    if initial is None or not surroundings.pinned:
        return gripper
    return Pose.from_rotation(gripper.position, initial.gripper.rotation)


def past_of(discretisation, initial, history):
    """Return the History, on a mesh, of the DLO in the Shape `initial` or None.

    Args:
        history: History that counts if `initial` is None or of another rod
    """
    known = None if initial is None else initial._history
    if known is not None and not np.array_equal(known.positions, initial.positions):
        # carried somewhere else since, or predicted: there it has touched nothing yet
        known = known.set_alone(len(known.node_force))
    return discretisation.past(known, history)


def accurate_equilibrium(surroundings, basis, accuracy, gripper, initial, history, far_end):
    """Return the Shape whose error estimate is within `accuracy` (m), and the number of kicks.

    Starts on the mesh of `initial` (a Shape or None), so that a motion pays for grading once.
    A shape that misses the accuracy on the largest mesh says so: `converged` is False.
    """
    discretisation = _first_mesh(surroundings, basis, initial)
    kicks = 0
    while True:
        shape, kicked = step(discretisation, gripper, initial, history, far_end)
        kicks += kicked
        if not shape.converged or shape.error_estimate <= _MARGIN * accuracy:
            return shape, kicks
        better = _refined(discretisation, shape, accuracy)
        if better is None:
            return replace(shape, converged=shape.error_estimate <= accuracy), kicks
        discretisation = better
        if not surroundings.rod.yields and not surroundings.obstacles and far_end is None:
            initial = shape  # a better start; where the way counts, the step is made again


def _first_mesh(surroundings, basis, initial):
    """Return the Discretisation to begin with: in these surroundings, on the mesh of `initial`."""
    known = None if initial is None else initial._discretisation
    if known is None or known.basis != basis:
        s = np.linspace(0, surroundings.rod.length, _FIRST_ELEMENTS + 1)
        return Discretisation(surroundings, s, basis, _FIRST_TERMS)
    if same(known.surroundings, surroundings):
        return known
    s = np.append(known.s[:-1], surroundings.rod.length)
    return Discretisation(surroundings, s, basis, known.n_terms)


def _refined(discretisation, shape, accuracy):
    """Return a finer Discretisation, or None at the limits."""
    elements, terms = len(shape.element_strains), discretisation.n_terms
    from_mesh = shape.error_estimate
    if discretisation.basis != 'local':
        free = Discretisation(discretisation.surroundings, discretisation.s, 'local', 0)
        from_mesh = equilibrium(free, shape.gripper, shape.element_strains, 'newton',
                                shape._history, shape.far_end)[0].error_estimate
        if shape.error_estimate > 1.5 * from_mesh or from_mesh < 0.3 * _MARGIN * accuracy:
            terms = min(terms + max(2, terms // 4), _MOST_TERMS)
    s = discretisation.s
    if from_mesh > 0.8 * _MARGIN * accuracy:
        growth = np.clip(np.sqrt(from_mesh / (0.5 * _MARGIN * accuracy)), 1.2, 2.5)
        wanted = min(int(np.ceil(growth * elements)), _MOST_ELEMENTS)
        s = graded_mesh(shape.s, shape.element_strains, wanted)
    if terms == discretisation.n_terms and s.size == discretisation.s.size:
        return None
    return Discretisation(discretisation.surroundings, s, discretisation.basis, terms)


def graded_mesh(s, strains, elements):
    """Return nodes (elements + 1,) that share out evenly the error of arcs of constant strain.

    An arc whose strain should change at the rate u' misplaces its far end by about h^3 |u'|, so
    the best density of elements goes with the cube root of |u'|; a floor keeps a third of the
    elements for where nothing seems to happen.

    Args:
        s: (N + 1,) nodes of a known shape
        strains: (N, 3) its strains
        elements: how many are wanted
    """
    middle = 0.5 * (s[1:] + s[:-1])
    rate = np.linalg.norm(np.diff(strains, axis=0), axis=1) / np.diff(middle)
    density = np.cbrt(np.interp(middle, s[1:-1], rate))
    h = np.diff(s)
    mean = np.sum(density * h) / s[-1]
    share = np.cumsum((density / mean if mean > 0 else 0.0) * h + 0.5 * h)
    share = np.concatenate([[0.0], share]) / share[-1]
    nodes = np.interp(np.linspace(0, 1, elements + 1), share, s)
    nodes[0], nodes[-1] = 0.0, s[-1]
    return nodes
