# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Gripper poses in, shapes out: live on topics, and by service."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import monotonic
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from std_srvs.srv import Trigger

from dlo_planner.direct.shape import Shape
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.model.holds import GRIPS, FarEnd, Holds
from dlo_planner.model.pose import Pose
from dlo_planner.plan.stage import arm_of
from dlo_planner.progress import Latest
from dlo_planner.ros.inputs import feedback_of, inside_of, pose_in
from dlo_planner.ros.lifecycle import LATCHED
from dlo_planner.ros.plan import refuse_tolerance
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import State, pose_topic
from dlo_planner.ros.status import Part, Shared
from dlo_planner.view.scene import shape_primitives
from msg_helpers.poses import wrench_in, wrench_msg
from msg_helpers.trajectories import shape_bytes, shape_path

_STANDS = 0.05  # s without a gripper pose, after which the far end's poses give shapes


def predicted(state: State, gripper: Pose, name: str, initial: Shape | None = None,
              holds: Holds = ()) -> Shape:
    """Return the Shape of the DLO in a gripper Pose, and in Holds."""
    if state.scene.grasped is not None:
        shape = state.scene.grasped.track([gripper], initial=initial)[0]
    else:
        shape = state.scene.direct.track([gripper], initial=initial, holds=holds)[0]
    if shape.converged:
        return shape
    for hold in holds:
        span = float(np.linalg.norm(hold.pose.position - gripper.position))
        name = f'{name}, {pose_topic(arm_of(hold))} {span:.3g} m away'
    inside = inside_of(state.scene, gripper, name)
    if inside:
        raise Refused(Cause.IN_OBSTACLE, inside)
    raise Refused(Cause.NO_SHAPE, f'{name}: no stable shape found: residual {shape.residual:.3g}, '
                  f'stability {shape.stability:.3g} after {shape.iterations} iterations')


class ShapePredictor(Part):
    """Hears the gripper, and predicts the DLO's shape for its newest pose in a thread of its own.

    `follows` takes each Pose of the tool frame and its stamp, and returns how far the DLO is off
    its plan, m, or nan.
    """

    def __init__(self, shared: Shared, control: Any, asking: Any,
                 follows: Callable[[Pose, Time], float]) -> None:
        super().__init__(shared)
        node = self.node
        self._follows, self._closed = follows, False
        self._out = node.add_publisher(Path, '~/predicted_shape', LATCHED)
        self._wrench_out, self._far_wrench_out = (
            node.add_publisher(WrenchStamped, f'~/{name}', LATCHED)
            for name in ('gripper_wrench', 'far_end_wrench'))
        node.add_newest(PoseStamped, '~/far_end_pose', self._on_far_end)
        node.add_newest(PoseStamped, '~/gripper_pose', self._on_pose)
        node.add_service(Trigger, '~/reset', self._on_reset, control)
        node.add_service(GetPlan, '~/predict_shape', self._on_predict_shape, asking)
        self._newest = Latest(lambda _: None)  # what a job raises is told by itself

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        self._newest.close()
        self._newest.wait(1.0)

    def _on_pose(self, msg: PoseStamped) -> None:
        with self.status.answering('gripper_pose', counter='poses refused', told=False):
            scene = self.store.state.scene
            if scene.by_joints:
                raise Refused(Cause.INVALID_PARAMETER, 'gripper_pose: it has no effect with '
                              'execute.through = joints: the gripper is where joint_states say')
            self._hear(pose_in(scene, msg, 'gripper_pose', self.frames), msg.header.stamp)

    def hear(self, pose: Pose, stamp: Time) -> None:
        """Take in where the joints of an arm say that the tool frame is."""
        with self.status.answering('joint_states', counter='poses refused', told=False):
            self._hear(pose, stamp)

    def _hear(self, pose: Pose, stamp: Time) -> None:
        self.statistics.count('poses received')
        arrived = monotonic()
        heard = feedback_of(self.node, pose, stamp, arrived, self._follows(pose, stamp))
        state = self.store.change(lambda state: state.with_feedback(heard))
        self._look(pose.compose(state.scene.tool), stamp, arrived)

    def _on_far_end(self, msg: PoseStamped) -> None:
        """Hold the far end there; where the gripper stands, the shape follows as well."""
        with self.status.answering('far_end_pose', counter='poses refused', told=False):
            scene, arrived = self.store.state.scene, monotonic()
            if scene['far_end.hold'] == 'free':
                raise Refused(Cause.INVALID_PARAMETER, 'far_end_pose: it has no effect with '
                              f'far_end.hold = free: expected one of {", ".join(GRIPS)}')
            pose = pose_in(scene, msg, 'far_end_pose', self.frames)
            heard = feedback_of(self.node, pose, msg.header.stamp, arrived)
            state = self.store.change(lambda state: replace(state, far_end=heard))
            last = state.feedback
            if state.gripper is not None and (last is None or arrived - last.arrived > _STANDS):
                self._look(state.gripper, msg.header.stamp, arrived)

    def _look(self, gripper: Pose, stamp: Time, arrived: float) -> None:
        self._newest.submit(partial(self._predict, gripper, stamp, arrived))

    def _predict(self, gripper: Pose, stamp: Time, arrived: float) -> None:
        with self.status.answering('gripper_pose', counter='poses refused', told=False):
            before = self.store.state
            now, scene = monotonic(), before.scene
            if before.held_at(now) is None and before.far_end is not None and (
                    scene['far_end.hold'] != 'free'):
                self.status.warn('far end', 'far_end_pose: the last one is older than '
                                 f'far_end.timeout = {scene["far_end.timeout"]:g} s: the far end '
                                 'counts as free')
            shape = predicted(before, gripper, 'gripper_pose', before.shape, before.holds_at(now))
            if self._closed:
                return
            self.store.change(lambda state: state.with_shape(shape, before))
            if shape.jumped:
                self.status.warn('jump', 'the DLO jumped into another shape on the way to this '
                                    'pose')
            self._out.publish(shape_bytes(shape, scene.frame_id, stamp))
            self._send_wrenches(scene, shape, stamp)
            self.statistics.shape_done(shape, monotonic() - arrived)
            self.markers.show('shape', scene.frame_id, stamp,
                              lambda: shape_primitives(shape, scene['markers.color']))

    def _send_wrenches(self, scene: Scene, shape: Shape, stamp: Time) -> None:
        """Publish what the DLO does to the gripper and to what holds its far end."""
        sensor = shape.gripper.compose(scene.tool.inverse())
        self._wrench_out.publish(wrench_msg(wrench_in(
            sensor, shape.gripper, -shape.gripper_wrench), scene['tool.frame_id'], stamp))
        if shape.far_end is not None:
            end = Pose.from_rotation(shape.positions[-1], shape.frames[-1])
            self._far_wrench_out.publish(wrench_msg(wrench_in(
                shape.far_end.pose, end, -shape.far_wrench), scene['far_end.frame_id'], stamp))

    def _on_predict_shape(self, request: GetPlan.Request,
                          response: GetPlan.Response) -> GetPlan.Response:
        stamp = request.start.header.stamp
        with self.status.answering('predict_shape', stamp=stamp) as outcome:
            state, name = self.store.state, 'predict_shape.start'
            refuse_tolerance(request, 'predict_shape')
            gripper = pose_in(state.scene, request.start, name, self.frames).compose(
                state.scene.tool)
            shape = predicted(state, gripper, name, holds=self._asked_end(state, request))
            response.plan = shape_path(shape, state.scene.frame_id, stamp)
            outcome.message = f'{len(response.plan.poses)} nodes'
        return response

    def _asked_end(self, state: State, request: GetPlan.Request) -> Holds:
        """Return what holds the far end in a request; nothing if the frame of its goal is empty."""
        if not request.goal.header.frame_id:
            return ()
        pose = pose_in(state.scene, request.goal, 'predict_shape.goal', self.frames)
        if state.scene['far_end.hold'] == 'free':
            raise Refused(Cause.INVALID_PARAMETER, 'predict_shape.goal: far_end.hold = free says '
                          f'that nothing holds the far end: expected one of {", ".join(GRIPS)}, or '
                          'an empty frame')
        return (FarEnd(pose, state.scene['far_end.hold']),)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self.status.answering('reset', answer=response) as outcome:
            self.store.change(State.reset)
            outcome.message = 'the next pose starts from the natural shape'
        return response
