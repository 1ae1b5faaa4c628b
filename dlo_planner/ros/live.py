# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Gripper poses in, shapes out: live on topics, and by service."""

from collections.abc import Callable
from threading import Condition, Thread
from time import monotonic
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from std_srvs.srv import Trigger

from dlo_planner.direct.shape import Shape
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.guards import Heard
from dlo_planner.model.pose import Pose
from dlo_planner.ros.door import inside_of, pose_in
from dlo_planner.ros.gate import Gate
from dlo_planner.ros.parts import Parts
from dlo_planner.ros.picture import markers_of_shape
from dlo_planner.ros.qos import LATCHED, LATEST
from dlo_planner.ros.state import State
from dlo_planner.view.dlo_items import drawn_radius
from msg_helpers.paths import shape_path


def predicted(state: State, gripper: Pose, name: str, initial: Shape | None = None) -> Shape:
    """Return the Shape of the DLO in a gripper Pose.

    Parameters
    ----------
    state : State
    gripper : Pose
        Pose of the gripper frame.
    name : str
        How the sender knows it.
    initial : Shape, optional
        Shape before, None: the natural one.

    Raises
    ------
    Refused
        There is none, and why.
    """
    shape = state.scene.direct.track([gripper], initial=initial)[0]
    if shape.converged:
        return shape
    inside = inside_of(state.scene, state.bodies, gripper, name)
    if inside:
        raise Refused(Cause.IN_OBSTACLE, inside)
    raise Refused(Cause.NO_SHAPE, f'{name}: no stable shape found: residual {shape.residual:.3g}, '
                  f'stability {shape.stability:.3g} after {shape.iterations} iterations')


class LiveShapes:
    """Hears the gripper, and predicts the DLO's shape for its newest pose in a thread of its own.

    Parameters
    ----------
    node : Gate
        Rclpy Node.
    parts : Parts
    hearing, asking, resetting : object
        Callback groups: poses that come quicker than they are heard starve no service.
    follows : callable
        Takes each Pose of the tool frame and its stamp, returns how far the DLO is off its plan, m,
        or nan.
    """

    def __init__(self, node: Gate, parts: Parts, hearing: Any, asking: Any, resetting: Any,
                 follows: Callable[[Pose, Time], float]) -> None:
        self._follows = follows
        self._clock, self._store, self._health = node.get_clock(), parts.store, parts.health
        self._reporter, self._picture = parts.reporter, parts.picture
        self._frames = parts.frames
        self._waiting, self._closed = Condition(), False
        self._newest: tuple[Pose, Time, float] | None = None
        self._out = node.create_publisher(Path, '~/predicted_shape', LATCHED)
        node.create_subscription(PoseStamped, '~/gripper_pose', self._on_pose, LATEST,
                                 callback_group=hearing)
        node.create_service(Trigger, '~/reset', self._on_reset, callback_group=resetting)
        node.create_service(GetPlan, '~/predict_shape', self._on_predict_shape,
                            callback_group=asking)
        self._thread = Thread(target=self._work, name='shapes', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        with self._waiting:
            self._closed = True
            self._waiting.notify()
        self._thread.join(timeout=1.0)

    def _on_pose(self, msg: PoseStamped) -> None:
        with self._reporter.answering('gripper_pose', counter='poses refused', told=False):
            self._health.count('poses received')
            arrived = monotonic()
            pose = pose_in(self._store.state.scene, msg, 'gripper_pose', self._frames)
            stamp = msg.header.stamp
            age = 1e-9 * (self._clock.now().nanoseconds - stamp.nanosec) - stamp.sec
            heard = Heard(pose, arrived, age, self._follows(pose, stamp),
                          stamp.sec + 1e-9 * stamp.nanosec)
            state = self._store.change(lambda state: state.hearing(heard))
            with self._waiting:
                self._newest = pose.compose(state.scene.tool), stamp, arrived
                self._waiting.notify()

    def _work(self) -> None:
        while True:
            with self._waiting:
                while self._newest is None and not self._closed:
                    self._waiting.wait()
                if self._closed:
                    return
                newest, self._newest = self._newest, None
            if newest is None:
                continue
            with self._reporter.answering('gripper_pose', counter='poses refused', told=False):
                self._predict(*newest)

    def _predict(self, gripper: Pose, stamp: Time, arrived: float) -> None:
        before = self._store.state
        shape = predicted(before, gripper, 'gripper_pose', before.shape)
        if self._closed:
            return
        self._store.change(lambda state: state.with_shape(shape, before))
        if shape.jumped:
            self._reporter.warn('jump', 'the DLO jumped into another shape on the way to this pose')
        frame_id = before.scene.frame_id
        self._out.publish(shape_path(shape, frame_id, stamp))
        self._health.shape_done(shape, monotonic() - arrived)
        radius, color = drawn_radius(before.scene.direct.rod), before.scene.color
        self._picture.show('shape', lambda: markers_of_shape(shape, radius, frame_id, stamp, color))

    def _on_predict_shape(self, request: GetPlan.Request,
                          response: GetPlan.Response) -> GetPlan.Response:
        stamp = request.start.header.stamp
        with self._reporter.answering('predict_shape', stamp=stamp) as outcome:
            state, name = self._store.state, 'predict_shape.start'
            gripper = pose_in(state.scene, request.start, name, self._frames).compose(
                state.scene.tool)
            shape = predicted(state, gripper, name)
            response.plan = shape_path(shape, state.scene.frame_id, stamp)
            outcome.message = f'{len(response.plan.poses)} nodes'
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._reporter.answering('reset', answer=response) as outcome:
            self._store.change(State.reset)
            outcome.message = 'the next pose starts from the natural shape'
        return response
