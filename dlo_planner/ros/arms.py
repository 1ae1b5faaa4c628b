# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The arms that hold the DLO beside the gripper: what is heard of them, and what they are told."""

from functools import partial
from time import monotonic
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from visualization_msgs.msg import MarkerArray

from dlo_planner.execute.execution import Execution
from dlo_planner.model.holds import Holds
from dlo_planner.plan.stage import FAR_END
from dlo_planner.ros.inputs import feedback_of, pose_in
from dlo_planner.ros.lifecycle import LATCHED, REQUEST
from dlo_planner.ros.state import PlanResult, is_arm, pose_topic
from dlo_planner.ros.status import Part, Shared
from msg_helpers.markers import holds_msg
from msg_helpers.poses import pose_stamped_msg

_MOST_ARMS = 16  # that have topics: whoever asks for plans names them


class Arms(Part):
    """Gives each arm of a plan its topics when the plan is made, and says what holds where."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(shared)
        self._out: dict[str, Any] = {}  # publishers of commands, by the name of the arm
        self._holds_out = self.node.add_publisher(MarkerArray, '~/holds', LATCHED)

    def take(self, made: PlanResult) -> None:
        """Make the topics of a plan's arms, and say what holds the DLO as it begins."""
        names = dict.fromkeys([*(made.whole or made.plan).arms,
                               *([] if made.far_end is None else [FAR_END])])
        for name in names:
            if name not in self._out and is_arm(name) and len(self._out) < _MOST_ARMS:
                self._open(name)
        self.show(made.plan.shapes[0].holds, made.scene.frame_id, made.stamp)

    def show(self, holds: Holds, frame_id: str, stamp: Time) -> None:
        """Say what holds the DLO now, or has to before it moves on."""
        self._holds_out.publish(holds_msg(holds, frame_id, stamp))

    def send(self, execution: Execution, stamp: Time) -> None:
        """Command the other arms of an Execution, those that are to be commanded now."""
        for one in execution.others:
            if one.sending is not None and one.name in self._out:
                self._out[one.name].publish(pose_stamped_msg(one.sending, one.frame_id, stamp))

    def _open(self, name: str) -> None:
        if name != FAR_END:  # whose poses are heard anyway
            self.node.add_newest(PoseStamped, f'~/{pose_topic(name)}', partial(self._on_pose, name))
        self._out[name] = self.node.add_publisher(PoseStamped, f'~/gripper_command/{name}', REQUEST)

    def _on_pose(self, name: str, msg: PoseStamped) -> None:
        topic, arrived = pose_topic(name), monotonic()
        with self.status.answering(topic, counter='poses refused', told=False):
            pose = pose_in(self.store.state.scene, msg, topic, self.frames)
            heard = feedback_of(self.node, pose, msg.header.stamp, arrived)
            self.store.change(lambda state: state.with_arm(name, heard))
