"""Threading through more than two cut-outs: nearest to all of their centres that are passed.

The gripper has six degrees of freedom, and how far the DLO has gone through each cut-out but the
first is free: two centres can be hit, three in general cannot. So their weighted distances are
minimised, by the search for any task. What is ahead counts smoothly more as the free end comes
near, so that the gripper's way is continuous: the DLO, extended straight on, aims at it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.errors import NotConverged
from dlo_planner.inverse.clearance import sheet_of
from dlo_planner.inverse.continuity import refusal_for_leap
from dlo_planner.inverse.draft import Brief, Draft
from dlo_planner.inverse.penalties import DirectionAt, PositionAt, Through
from dlo_planner.inverse.plan import waypoint_at
from dlo_planner.inverse.search import minimise_penalty
from dlo_planner.inverse.threading import thread
from dlo_planner.model.pose import Pose

_BLEND = 0.15         # of the length: from there on a cut-out ahead counts
_LONGEST_STEP = 1 / 20  # of the length: depth steps of the continuation
_FREE = 1e-3          # weight of the first normal, which decides only what is left free


def thread_sequence(simulator, cutouts, weights, depths, start, brief):
    """Return the Plan; see `InverseSimulator.thread_sequence` for what the arguments mean."""
    length = simulator.rod.length
    centres = np.array([cutout.centre for cutout in cutouts])
    apart = np.concatenate([[0.0], np.linalg.norm(np.diff(centres, axis=0), axis=1).cumsum()])
    sheets = [sheet_of(cutout, length, brief.obstacles) for cutout in cutouts]
    draft = Draft(depths, brief)
    begin = thread(simulator, cutouts[0], [0.0], start, None, 'coupled', Brief(brief.speeds))
    shape = begin.shapes[0]
    depth = 0.0
    for wanted in depths:
        while True:
            target = min(wanted, depth + _LONGEST_STEP * length)
            tasks = _tasks(cutouts, weights, apart, target, length)
            found = _nearest(simulator, tasks, shape, target - depth)
            if found is None or not found.converged:
                raise draft.refusal('equilibrium', wanted - depth, 'no stable shape was found '
                                    f'that is nearest to the centres beyond depth {depth:g} m')
            shape, depth = found.shape, target
            if depth == wanted:
                break
        refusal = refusal_for_leap(simulator, draft, shape)
        if refusal is not None:
            raise refusal
        waypoint = waypoint_at(shape, centres[0], length - wanted, None)
        for centre in centres[1:]:
            s = Through(centre, length - wanted).passage(shape)
            if s > length:
                break
            waypoint = waypoint.also(centre, s)
        draft.add(waypoint.inside(cutouts, sheets, brief.radius))
    return draft.finished()


def _tasks(cutouts, weights, apart, depth, length):
    """Return the penalties at a depth.

    Args:
        apart: (k,) how deep the DLO is, were it straight, as its free end reaches each centre, m
    """
    share = np.clip((depth - apart) / (_BLEND * length) + 1, 0, 1)
    share = share**2 * (3 - 2 * share)
    tasks = [PositionAt(length - depth, cutouts[0].centre, weights[0])]
    if share[1] < 1:
        tasks.append(DirectionAt(length - depth, cutouts[0].normal,
                                 _FREE * (1 - share[1]) * length))
    if share[1] > 0:
        # Two can be hit, whatever the weight: so the second one may decide what the normal did.
        tasks.append(Through(cutouts[1].centre, length - depth,
                             weights[1] * (1.0 if share[1] == 1 else _FREE * share[1])))
    return tasks + [Through(cutout.centre, length - depth, weight * part)
                    for cutout, weight, part in zip(cutouts[2:], weights[2:], share[2:],
                                                    strict=True) if part > 0]


@dataclass(frozen=True)
class _NotRolled:
    """The gripper has not turned about its own axis since a pose: what is free for a round DLO."""

    before: Pose
    weight: float

    def residuals(self, shape):
        turn = Rotation.from_matrix(shape.gripper.rotation @ self.before.rotation.T).as_rotvec()
        return self.weight * np.array([turn @ self.before.direction])

    def slopes(self, shape, sensitivity):
        del shape, sensitivity  # to first order about the pose before
        return self.weight * np.append(self.before.direction, np.zeros(3))[None]


def _nearest(simulator, tasks, shape, step):
    """Return the Found that follows `shape` after a step in depth, or None."""
    tasks = [*tasks, _NotRolled(shape.gripper, _FREE * shape.s[-1])]
    start = Pose.from_rotation(shape.gripper.position + step * shape.gripper.direction,
                               shape.gripper.rotation)
    try:
        return minimise_penalty(simulator, tasks, start, initial=shape)
    except NotConverged:
        return None
