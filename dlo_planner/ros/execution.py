"""A trajectory streamed in real time: where the gripper should be now."""

from threading import Lock

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.pose import angle_between
from dlo_planner.ros.proof import Proof


def ready(made, proof, now):
    """Return the Trajectory to be executed: the one that was proved.

    Args:
        made: Made, the last plan, or None
        proof: the newest Proof, or None; it counts if it is of that plan
        now: Pose of the gripper, or None

    Raises:
        InvalidTask: naming what is missing, or why it must not be executed
    """
    if made is None:
        raise InvalidTask('there is no plan yet')
    if proof is None or proof.plan is not made.plan:
        proof = Proof(made.plan)
    if not proof.safe:
        raise InvalidTask(proof.reason)
    if now is None:
        raise InvalidTask('no gripper pose is known: send ~/gripper_pose')
    scene, first = made.scene, made.plan.grippers[0]
    away = float(np.linalg.norm(now.position - first.position))
    if away > scene.start_distance:
        raise InvalidTask(f'the gripper is {away:.3g} m from where the plan begins: expected '
                          f'execute.start_distance = {scene.start_distance:g} m at most')
    angle = angle_between(now.rotation, first.rotation)
    if angle > scene.start_angle:
        raise InvalidTask(f'the gripper is turned by {angle:.3g} rad from where the plan begins: '
                          f'expected execute.start_angle = {scene.start_angle:g} rad at most')
    return proof.report.trajectory


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

        The last command is the end of the trajectory, after that nothing runs.
        """
        with self._lock:
            if self._running is None:
                return None
            trajectory, back, frame_id, begun = self._running
            since = now - begun
            if since >= trajectory.duration:
                self._running = None
        return trajectory.at([since])[0][0].compose(back), frame_id
