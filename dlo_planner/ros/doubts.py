# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What speaks against doing as an estimate of the DLO says, in words."""

from dataclasses import replace

import numpy as np

from dlo_planner.execute.execution import Execution
from dlo_planner.identify.correction import Correction
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.observing import Observing
from dlo_planner.identify.steering import Steered
from dlo_planner.model.arrays import Ints
from dlo_planner.model.surface import Surface
from dlo_planner.plan.clearance import clearance
from dlo_planner.plan.motion.trajectory import Trajectory
from dlo_planner.plan.plan import Plan
from dlo_planner.ros.scene import Scene

_ANSWER = 2.0  # a DLO moves by less than so many times a jerk of its gripper
_ERRORS = 5.0  # standard deviations by which points may be off on the mean
_MORE = 0.2    # of the points, by which more may be none of the DLO's than are expected
_SOME = 0.95   # of them
_STOPPING = 3.0  # s before the entry, at which a motion can still come to rest in front of it


def disagreement(observing: Observing) -> str:
    """Return in words that the last looks do not agree with the estimate."""
    return ('looks at the DLO do not agree with what was expected of it (surprise '
            f'{observing.surprise:.3g}): it slips, swings or touches something, or the robot is '
            'elsewhere than it says; call ~/reset, let it hang at rest before the camera, call '
            '~/identify, and plan again')


def unexplained(observing: Observing, speed: float = 0.0) -> str:
    """Return in words why an Estimate is not of the DLO that is seen, '' if it may be.

    It tells of a DLO that hangs freely; one that touches something, or is held elsewhere, is none.

    Parameters
    ----------
    observing : Observing
        Observing that has looked.
    speed : float, optional
        Speed in m/s, of the gripper at most: stamps may be wrong.
    """
    # a point is off across the DLO, along two axes
    seeing, estimate = observing.seeing, observing.estimate
    size = np.sqrt(2 * (seeing.noise**2 + seeing.bias**2) + seeing.sway**2)
    most = _ERRORS * float(size) + seeing.stamps * speed
    if not observing.off <= most:
        return (f'the points are {observing.off:.3g} m off the DLO as it is estimated: expected '
                f'at most {most:.3g} m, by observe.noise = {seeing.noise:g} m')
    few = min(seeing.outliers + _MORE, _SOME)
    if estimate.outliers > few:
        return (f'{estimate.outliers:.0%} of the points are none of the DLO as it is estimated: '
                f'expected at most {few:.0%}, by observe.outliers = {seeing.outliers:g}')
    return ''


def doubts(correction: Correction, observing: Observing, scene: Scene) -> str:
    """Return in words why a Correction must not be executed, '' if it may.

    It is not simulated as a plan is: the gripper has to keep its workspace, and the DLO clear of
    obstacles, at each waypoint.

    Parameters
    ----------
    correction : Correction
        By the estimate of `observing`.
    observing : Observing
    scene : Scene
        Scene of the plan.
    """
    if not correction.converged:
        return 'a waypoint has no stable shape for the DLO as it is estimated'
    wrong = unexplained(observing, scene.limits.linear_speed)
    if wrong:
        return wrong
    moved = float(np.linalg.norm(correction.offsets[:, 3:], axis=1).max(initial=0.0))
    if moved > scene.seeing.largest_correction:
        return (f'it moves the gripper by {moved:.3g} m: expected observe.largest_correction = '
                f'{scene.seeing.largest_correction:g} m at most')
    return _leaves(correction, scene)


def _leaves(correction: Correction, scene: Scene) -> str:
    """Return in words what the gripper or the DLO would run into."""
    rooms = [scene.workspace.min_margin(pose) for pose in correction.grippers]
    name, room = min(rooms, key=lambda one: one[1])
    if room < 0:
        return f'it moves the gripper {-room:.3g} m beyond {name}'
    bodies, surface = scene.workspace.keep_out, Surface.of(scene.direct.rod)
    for index, body in enumerate(bodies):
        room = min(clearance([body], surface, shape) for shape in correction.shapes)
        if room < 0:
            return f'it moves the DLO {-room:.3g} m into {type(body).__name__} {index}'
    return ''


def kept_out(miss: float, scene: Scene, left: float, moving: float) -> str:
    """Return in words why a motion has to stop before the cut-out, '' if it may go on.

    It goes in if the DLO is inside the cut-out with 95 %, as far as the estimate tells, and with
    what motion adds. Whether it is, is judged when the stop has to begin; after the entry it would
    be of no use.

    Parameters
    ----------
    miss : float
        By how much the DLO may miss the cut-out at rest, with 95 %, m.
    scene : Scene
        Scene of the plan.
    left : float
        Seconds of the motion until the first cut-out is reached.
    moving : float
        By how much motion displaces the DLO in the cut-out at most, m.
    """
    radius, thick = scene.cutout_radius, scene.direct.rod.radius or 0.0
    if radius is None or not isinstance(thick, float) or not 0 < left <= _STOPPING:
        return ''
    bound, room = miss + moving, radius - thick
    return '' if bound <= room else (
        f'the DLO may miss the cut-out by {bound:.3g} m (95 %, {moving:.3g} m of it by '
        f'motion): expected at most the room of {room:.3g} m; let it hang at rest before the '
        'camera, call ~/identify, and plan again')


def in_motion(execution: Execution) -> float:
    """Return by how much motion displaces the DLO of an Execution in a cut-out at most, m.

    By what was simulated for the proof, and by what late commands did. A DLO that is displaced by a
    jerk of its gripper swings by less than twice the jerk (by its slowest vibration 1.57 times).
    """
    way = execution.way.trajectory if isinstance(execution.way, Steered) else execution.way
    simulated = way.motion if isinstance(way, Trajectory) else None
    bound = 0.0 if simulated is None else float(np.nan_to_num(simulated.bound, posinf=np.inf))
    return bound + _ANSWER * execution.shaken


def bound_of(estimate: Estimate, plan: Plan, way: Steered, waypoints: Ints) -> float:
    """Return within how many m the DLO passes the center at waypoints of a motion with 95 %.

    A correction is blended in over the slowest periods of the DLO, which may end after the entry:
    so the poses that are commanded then count, not those that are aimed at.

    Parameters
    ----------
    estimate : Estimate
    plan : Plan
    way : Steered
        Steered along the plan.
    waypoints : ndarray, shape (k,)
        Their indices, of such that pass the center.
    """
    if not waypoints.size:
        return 0.0
    commanded, _, _ = way.at(way.reached(plan.times[waypoints]))
    grippers = list(plan.grippers)
    for k, pose in zip(waypoints, commanded, strict=True):
        grippers[k] = pose
    moved = replace(plan, grippers=tuple(grippers))
    return float(estimate.miss(moved, waypoints).bound.max(initial=0.0))
