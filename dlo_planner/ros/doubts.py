# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What speaks against doing as an estimate of the DLO says, in words."""

import numpy as np

from dlo_planner.identify.correction import Correction
from dlo_planner.model.surface import Surface
from dlo_planner.plan.clearance import clearance
from dlo_planner.ros.observing import Observing
from dlo_planner.ros.scene import Scene

_ERRORS = 5.0  # standard deviations by which points may be off on the mean
_MORE = 0.2    # of the points, by which more may be none of the DLO's than are expected
_SOME = 0.95   # of them
_STOPPING = 3.0  # s before the entry, at which a motion can still come to rest in front of it


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


def kept_out(correction: Correction, scene: Scene, entry: float, now: float) -> str:
    """Return in words why a motion has to stop before the cut-out, '' if it may go on.

    It goes in if the DLO is inside the cut-out with 95 %, as far as the estimate tells. Whether it
    is, is judged when the stop has to begin; after the entry it would be of no use.

    Parameters
    ----------
    correction : Correction
        The newest one, whether it is executed or not.
    scene : Scene
        Scene of the plan.
    entry : float
        Entry in s of the motion, when the first cut-out is reached.
    now : float
        Now in s of the motion.
    """
    radius, thick = scene.cutout_radius, scene.direct.rod.radius or 0.0
    if radius is None or not isinstance(thick, float) or not entry - _STOPPING <= now < entry:
        return ''
    bound, room = float(correction.miss.bound.max(initial=0.0)), radius - thick
    return '' if bound <= room else (
        f'the DLO may miss the cut-out by {bound:.3g} m (95 %): expected at most the room of '
        f'{room:.3g} m; let it hang at rest before the camera, call ~/identify, and plan again')
