# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans proved in a process of their own: step by step, the newest first."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from trajectory_msgs.msg import MultiDOFJointTrajectory

from dlo_planner.arm import rolls_freely
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DeadlineExceeded, DloPlannerError
from dlo_planner.execute.causes import Cause
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import Latest
from dlo_planner.ros.arm import ArmOutput
from dlo_planner.ros.lifecycle import LATCHED
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import PlanResult, Proof, State
from dlo_planner.ros.status import Part, Shared, figures_of, proof_figures
from dlo_planner.ros.worker import ATTEMPTS, ProcessLost, Worker, persistent
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.replay import AT_REST_ALONE, replay
from dlo_planner.verify.report import ValidationReport
from msg_helpers.poses import stamp_text
from msg_helpers.trajectories import timed_trajectory

_MOVED = 'the motion along the plan is still being made and checked: ask again'


def proofs(replayed: Callable[..., ValidationReport | None], scene: Scene, plan: Plan,
           before: Shape | None) -> Iterator[Proof]:
    """Yield the Proof of a Plan after each step; the last one is `done`."""
    end = plan.shapes[-1]  # what is touched on the way alone, the plan does not mean to touch
    touched = [end.obstacles[one.obstacle] for one in end.contacts]
    slowly = {'simulator': scene.direct, 'plan': plan, 'initial': before,
              'workspace': scene.workspace, 'obstacles': [  # of which the DLO has to stay clear
                  one for one in scene.direct.obstacles if one not in touched]}
    moving = {**slowly, 'limits': scene.motion_limits, 'tolerance': scene.tolerance,
              'deadline': scene['threading.deadline']}
    known = None
    for step in (slowly, moving):
        try:
            report = persistent(partial(replayed, **step))
        except Exception as error:  # whatever it is: the plan must not wait for ever
            yield Proof(plan, known, *_failed(error, scene['threading.deadline']))
            return
        if report is None:
            return
        known = report
        if not report.converged:
            yield Proof(plan, report, _lost(report), True, Cause.NOT_FOLLOWED)
            return
        if step is moving:
            # where something slides no more can be known: that is said, and no reason to refuse
            at_rest = report.reason.endswith(AT_REST_ALONE) and report.workspace_margin >= 0
            yield Proof(plan, report, '' if at_rest else report.reason, True,
                        Cause.NOT_CALM if report.reason and not at_rest else Cause.DONE)
        else:
            yield Proof(plan, report, _MOVED)


def _failed(error: Exception, deadline: float) -> tuple[str, bool, Cause]:
    """Return reason, done and Cause of a Proof that ends by an error."""
    if isinstance(error, DeadlineExceeded):
        return ('no motion that leaves the DLO at rest was found in threading.deadline = '
                f'{deadline:g} s of computing',
                True, Cause.PROOF_DEADLINE)
    if isinstance(error, ProcessLost):
        return f'tried {ATTEMPTS} times: {error}', True, Cause.PROOF_PROCESS
    name = '' if isinstance(error, DloPlannerError) else f'{type(error).__name__}: '
    return f'{name}{error}', True, Cause.PROOF_FAILED


def _lost(report: ValidationReport) -> str:
    return ('replayed slowly, the DLO does not follow the plan: largest miss '
            f'{report.position_error:.3g} m, largest deviation {report.deviation:.3g} m, '
            f'smallest stability {report.stability:.3g}')


_TIMED_STEP, _TIMED_MOST = 0.05, 20_000  # s between points of the timed trajectory; points


class ProofServer(Part):
    """Has plans proved by a worker, the newest one first; `arm` gets what is proved."""

    def __init__(self, shared: Shared, worker: Worker, arm: ArmOutput) -> None:
        super().__init__(shared)
        self._arm, self._worker = arm, worker
        self._begun: PlanResult | None = None  # whose proof has begun
        self._out = self.node.add_publisher(MultiDOFJointTrajectory, '~/gripper_trajectory_timed',
                                            LATCHED)
        self._newest = Latest(lambda _: None)  # what a job raises is told by itself
        self._job = self.node.counted(self._prove)

    def look(self) -> None:
        """Have the newest plan proved, if there is one and it is not yet."""
        self._newest.submit(self._job)

    def close(self) -> None:
        """Prove no more."""
        self._newest.close()

    def _prove(self) -> None:
        with self.status.answering('report', told=False):
            made = self.store.state.planned
            if made is None or made is self._begun:
                return
            self._begun = made

            def wanted() -> bool:
                return self.store.state.planned is made

            def replayed(**arguments: Any) -> ValidationReport | None:
                return self._worker.result(partial(replay, **arguments), wanted,
                                           patience=arguments.get('deadline') or 0.0)

            for proof in proofs(replayed, made.scene, made.plan, made.before):
                state = self.store.change(partial(State.with_proof, proof=proof))
                if state.proof is not proof:
                    return
                report = proof.report
                if proof.safe and report is not None and report.trajectory is not None:
                    self._publish(made, report, report.trajectory)
                    self._move_arm(made, report)
                self.statistics.note(proof_figures(proof))
                if proof.done:
                    self._tell(made, proof)

    def _tell(self, made: PlanResult, proof: Proof) -> None:
        """Say how a proof has ended, with its figures."""
        said, report = 'the plan is safe', proof.report
        if proof.safe and report is not None and report.reason:
            said = f'the plan is safe at rest: {report.reason}'
        if not proof.safe:
            said = f'the plan is not safe: {proof.reason}'
            self.status.failed('report', proof.cause, said)
        figures = {} if report is None else figures_of(report)
        self.status.tell('proof', proof.cause, said, made.asked, {
            'report': proof.state, 'plan stamp': stamp_text(made.stamp), **figures})

    def _publish(self, made: PlanResult, report: ValidationReport, way: Trajectory) -> None:
        scene = made.scene
        number = 1 + int(np.clip(np.ceil(way.duration / _TIMED_STEP), 1, _TIMED_MOST))
        self._out.publish(timed_trajectory(way, number, scene.tool, scene.frame_id, made.stamp))
        self.status.info(f'the plan is safe: {way.duration:.1f} s, ' + (
            report.reason or f'largest miss in motion {report.max_tracking_error:.1e} m, at most '
            f'{way.tolerance:.1e} m'))

    def _move_arm(self, made: PlanResult, report: ValidationReport) -> None:
        """Publish the motion of the robot's joints, where an arm is described."""
        with self.status.answering('joint_trajectory', told=False):
            self._arm.on_proof(report.trajectory, made.scene.tool, made.stamp,
                               rolls_freely(made.scene.direct, made.plan))
