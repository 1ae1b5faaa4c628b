# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The last plan is proved, and its motion published when it may be executed."""

from functools import partial
from typing import Any

import numpy as np
from trajectory_msgs.msg import MultiDOFJointTrajectory

from dlo_planner.arm import rolls_freely
from dlo_planner.plan.motion.trajectory import Trajectory
from dlo_planner.ros.arm import ArmOutput
from dlo_planner.ros.gate import Gate
from dlo_planner.ros.health import figures_of, stamp_text
from dlo_planner.ros.parts import Parts
from dlo_planner.ros.proof import Proof, proofs
from dlo_planner.ros.qos import LATCHED
from dlo_planner.ros.state import Made, State
from dlo_planner.ros.worker import Worker
from dlo_planner.verify.replay import replay
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.latest import Latest
from msg_helpers.trajectories import timed_trajectory

_TIMED_STEP, _TIMED_MOST = 0.05, 20_000  # s between points of the timed trajectory; points


class Verification:
    """Has plans proved, the newest one first.

    Parameters
    ----------
    node : Gate
        Rclpy Node.
    parts : Parts
    worker : Worker
        Computes the proofs.
    arm : ArmOutput
        ArmOutput, which gets what is proved.
    """

    def __init__(self, node: Gate, parts: Parts, worker: Worker, arm: ArmOutput) -> None:
        self._arm = arm
        self._store, self._health, self._reporter = parts.store, parts.health, parts.reporter
        self._worker = worker
        self._begun: Made | None = None  # whose proof has begun
        self._out = node.create_publisher(MultiDOFJointTrajectory, '~/gripper_trajectory_timed',
                                          LATCHED)
        self._newest = Latest(lambda _: None)  # what a job raises is told by itself
        self._job = node.counted(self._prove)

    def look(self) -> None:
        """Have the newest plan proved, if there is one and it is not yet."""
        self._newest.submit(self._job)

    def close(self) -> None:
        """Prove no more."""
        self._newest.close()

    def _prove(self) -> None:
        with self._reporter.answering('report', told=False):
            made = self._store.state.made
            if made is None or made is self._begun:
                return
            self._begun = made

            def wanted() -> bool:
                return self._store.state.made is made

            def replayed(**arguments: Any) -> ValidationReport | None:
                return self._worker.result(partial(replay, **arguments), wanted,
                                           patience=arguments.get('deadline') or 0.0)

            for proof in proofs(replayed, made.scene, made.plan, made.before):
                state = self._store.change(partial(_proved, proof))
                if state.proof is not proof:
                    return
                report = proof.report
                if proof.safe and report is not None and report.trajectory is not None:
                    self._publish(made, report, report.trajectory)
                    self._move_arm(made, report)
                self._health.plan_proved(proof)
                if proof.done:
                    self._tell(made, proof)

    def _tell(self, made: Made, proof: Proof) -> None:
        """Say how a proof has ended, with its figures."""
        said, report = 'the plan is safe', proof.report
        if not proof.safe:
            said = f'the plan is not safe: {proof.reason}'
            self._reporter.failed('report', proof.cause, said)
        figures = {} if report is None else figures_of(report)
        self._reporter.tell('proof', proof.cause, said, made.asked, {
            'report': proof.state, 'plan stamp': stamp_text(made.stamp), **figures})

    def _publish(self, made: Made, report: ValidationReport, way: Trajectory) -> None:
        scene = made.scene
        number = 1 + int(np.clip(np.ceil(way.duration / _TIMED_STEP), 1, _TIMED_MOST))
        self._out.publish(timed_trajectory(way, number, scene.tool, scene.frame_id, made.stamp))
        self._reporter.info(f'the plan is safe: {way.duration:.1f} s, largest miss in motion '
                            f'{report.max_tracking_error:.1e} m, at most {way.tolerance:.1e} m')

    def _move_arm(self, made: Made, report: ValidationReport) -> None:
        """Publish the motion of the robot's joints, where an arm is described."""
        with self._reporter.answering('joint_trajectory', told=False):
            self._arm.on_proof(report.trajectory, made.scene.tool, made.stamp,
                               rolls_freely(made.scene.direct, made.plan))


def _proved(proof: Proof, state: State) -> State:
    return state.proved(proof)
