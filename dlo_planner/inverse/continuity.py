"""Whether a DLO goes from one planned shape to the next, or falls into another on the way."""

import numpy as np

from dlo_planner.direct.continuation import shape_change

_QUIET = 0.1   # rad: a change of shape, besides the gripper's turn, that needs no second look
_SAME = 1e-3   # of the length: farther apart, two shapes are not the same
_SAMPLES = np.linspace(0, 1, 9)[1:]


def leap(simulator, before, shape):
    """Return how far (m) a DLO is from `shape` when the gripper goes there, 0 if it gets there.

    The direct simulation tells, wherever the shape changes more than the gripper's turn makes it.

    Args:
        simulator: DirectSimulator
        before: Shape where the gripper comes from; None: the DLO is set down at the new pose in
            its natural shape
        shape: Shape that is planned
    """
    if before is None:
        there = simulator.solve(shape.gripper)
    else:
        cosine = 0.5 * (np.vdot(shape.gripper.rotation, before.gripper.rotation) - 1)
        turn = np.arccos(min(max(cosine, -1.0), 1.0))
        if shape_change(before, shape) < _QUIET + turn:
            return 0.0
        there = simulator.track([shape.gripper], initial=before)[0]
    if there.converged and not there.jumped and same(there, shape):
        return 0.0
    return max(_apart(there, shape), _SAME * shape.s[-1])


def same(one, other):
    """Whether two Shapes in the same gripper, on any meshes, are the same."""
    return _apart(one, other) < _SAME * one.s[-1]


def _apart(one, other):
    """Return the largest distance (m) of some of their points."""
    samples = _SAMPLES * min(one.s[-1], other.s[-1])
    away = one.positions_at(samples) - other.positions_at(samples)
    return float(np.linalg.norm(away, axis=1).max())


def refusal_for_leap(simulator, draft, shape):
    """Return Infeasible if the next waypoint of a Draft cannot have this Shape, else None."""
    apart = leap(simulator, draft.last, shape)
    if not apart:
        return None
    if not draft.waypoints:
        why = ('set down there in its natural shape' if draft.last is None
               else 'brought there from its initial shape')
        return draft.refusal('start', apart, 'a stable shape does the task, but the DLO, '
                             f'{why}, falls into another one')
    return draft.refusal('continuity', apart, 'the DLO would fall into another shape on the way '
                         'there; closer waypoints may help')
