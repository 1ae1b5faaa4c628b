"""A plan streamed in real time: where the gripper should be now."""

from threading import Lock

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.pose import angle_between


def ready(made, proved, now):
    """Return `made` if it may be executed.

    Args:
        made: (Scene, Plan, Shape) of the last plan, or None
        proved: (Plan, Report) of the last one that was proved, or None
        now: Pose of the gripper, or None

    Raises:
        InvalidTask: naming what is missing
    """
    if made is None:
        raise InvalidTask('there is no plan yet')
    scene, plan, _ = made
    if proved is None or proved[0] is not plan:
        raise InvalidTask('the plan is still being checked: ask again')
    if not proved[1].converged:
        raise InvalidTask('the DLO does not follow this plan, see the report')
    if now is None:
        raise InvalidTask('no gripper pose is known: send ~/gripper_pose')
    away = float(np.linalg.norm(now.position - plan.grippers[0].position))
    if away > scene.start_distance:
        raise InvalidTask(f'the gripper is {away:.3g} m from where the plan begins: expected '
                          f'execute.start_distance = {scene.start_distance:g} m at most')
    angle = angle_between(now.rotation, plan.grippers[0].rotation)
    if angle > scene.start_angle:
        raise InvalidTask(f'the gripper is turned by {angle:.3g} rad from where the plan begins: '
                          f'expected execute.start_angle = {scene.start_angle:g} rad at most')
    return made


class Execution:
    """At most one Trajectory that runs; safe to use from several threads."""

    def __init__(self):
        self._lock = Lock()
        self._running = None

    def start(self, trajectory, tool, frame_id, now):
        """Begin at the time `now` in s.

        Args:
            trajectory: Trajectory of the gripper frame
            tool: Pose of the gripper frame in the tool frame
            frame_id: in which poses are given
        """
        with self._lock:
            self._running = (trajectory, tool.inverse(), frame_id, now)

    def stop(self):
        """Stop; return whether something ran."""
        with self._lock:
            ran, self._running = self._running is not None, None
        return ran

    def command(self, now):
        """Return Pose of the tool frame and frame_id for the time `now` in s; None if nothing runs.

        The last command is the end of the plan, after that nothing runs.
        """
        with self._lock:
            if self._running is None:
                return None
            trajectory, back, frame_id, begun = self._running
            since = now - begun
            if since >= trajectory.duration:
                self._running = None
        return trajectory.at([since])[0][0].compose(back), frame_id
