# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cut-outs in, gripper trajectories out: one plan at a time is made, and can be canceled."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from time import monotonic
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Path
from nav_msgs.srv import GetPlan
from std_srvs.srv import Trigger

from dlo_planner.direct.shape import Shape
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import interrupted_by
from dlo_planner.ros.door import goals_in, pose_in
from dlo_planner.ros.gate import Gate
from dlo_planner.ros.parts import Parts
from dlo_planner.ros.picture import markers_of_plan
from dlo_planner.ros.planning import Made, make_plan
from dlo_planner.ros.proof import Proof
from dlo_planner.ros.qos import LATCHED, REQUEST
from dlo_planner.ros.reporter import Outcome
from dlo_planner.ros.state import State
from dlo_planner.view.dlo_items import drawn_radius
from msg_helpers.paths import plan_path


class Run:
    """A plan that is being made, and whether it is still wanted.

    Parameters
    ----------
    deadline : float
        Seconds from now.
    now : callable, optional
        Function that returns s, steady.
    """

    def __init__(self, deadline: float, now: Callable[[], float] = monotonic) -> None:
        self._now, self._begun, self._deadline = now, now(), deadline
        self._reason = ''

    def cancel(self, reason: str) -> None:
        """Let the next `check` end it."""
        self._reason = reason

    def check(self) -> None:
        """Raise Refused if it is not wanted any more, or takes too long."""
        if self._reason:
            raise Refused(Cause.PLANNING_CANCELED, self._reason)
        passed = self._now() - self._begun
        if passed > self._deadline:
            raise Refused(Cause.PLANNING_DEADLINE, f'no plan was found in {passed:.3g} s: expected '
                          f'threading.planning_deadline = {self._deadline:g} s at most')


class Planning:
    """Answers planning requests.

    Parameters
    ----------
    node : Gate
        Rclpy Node.
    parts : Parts
    planning, answering : object
        Callback groups of the topics and of the services: goals that come quicker than plans are
        made starve no service.
    """

    def __init__(self, node: Gate, parts: Parts, planning: Any, answering: Any) -> None:
        self._clock, self._store, self._health = node.get_clock(), parts.store, parts.health
        self._reporter, self._picture = parts.reporter, parts.picture
        self._frames = parts.frames
        self._lock, self._turn, self._ended = Lock(), Lock(), ''
        self._run: Run | None = None
        self._out = node.create_publisher(Path, '~/gripper_trajectory', LATCHED)
        for kind, name, callback in ((PoseStamped, 'task_goal', self._on_goal),
                                     (Goals, 'task_goals', self._on_goals)):
            node.create_subscription(kind, f'~/{name}', callback, REQUEST,
                                     callback_group=planning)
        for kind, name, answer in (
                (GetPlan, 'plan_threading', self._on_plan_threading),
                (GetPlan, 'plan_two_cutouts', self._on_plan_two_cutouts),
                (Trigger, 'replan', self._on_replan)):
            node.create_service(kind, f'~/{name}', answer, callback_group=answering)

    def cancel(self, reason: str, for_good: bool = False) -> bool:
        """End the plan that is being made; return whether there was one.

        Parameters
        ----------
        reason : str
            In words.
        for_good : bool, optional
            Whether no other one may begin.
        """
        with self._lock:
            self._ended = reason if for_good else self._ended
            if self._run is None:
                return False
            self._run.cancel(reason)
            return True

    def allow(self) -> None:
        """Let plans begin again."""
        with self._lock:
            self._ended = ''

    # ---- requests ---------------------------------------------------------------------------

    def _on_goal(self, msg: PoseStamped) -> None:
        with self._answering('task_goal', msg.header.stamp) as outcome:
            state = self._store.state
            self._plan(outcome, state, (self._pose(state, msg, 'task_goal'),),
                       state.gripper)

    def _on_goals(self, msg: Goals) -> None:
        with self._answering('task_goals', msg.header.stamp) as outcome:
            state = self._store.state
            self._plan(outcome, state, goals_in(state.scene, msg, 'task_goals', self._frames),
                       state.gripper)

    def _on_plan_threading(self, request: GetPlan.Request,
                           response: GetPlan.Response) -> GetPlan.Response:
        with self._answering('plan_threading', request.goal.header.stamp) as outcome:
            state = self._store.state
            start = self._pose(state, request.start, 'plan_threading.start')
            goal = self._pose(state, request.goal, 'plan_threading.goal')
            response.plan = self._plan(outcome, state, (goal,), start.compose(state.scene.tool))
        return response

    def _on_plan_two_cutouts(self, request: GetPlan.Request,
                             response: GetPlan.Response) -> GetPlan.Response:
        with self._answering('plan_two_cutouts', request.start.header.stamp) as outcome:
            state = self._store.state
            goals = tuple(self._pose(state, msg, f'plan_two_cutouts.{name}') for name, msg in (
                ('start', request.start), ('goal', request.goal)))
            response.plan = self._plan(outcome, state, goals, state.gripper)
        return response

    def _on_replan(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._answering('replan', answer=response) as outcome:
            state = self._store.state
            if not state.goals:
                raise Refused(Cause.NO_GOAL, 'there is no goal yet: send one to ~/task_goal')
            self._plan(outcome, state, state.goals, state.gripper)
        return response

    @contextmanager
    def _answering(self, what: str, stamp: Time | None = None,
                   answer: Any = None) -> Iterator[Outcome]:
        with self._turn, self._reporter.answering(what, stamp=stamp, answer=answer,
                                                  counter='plans refused') as outcome:
            yield outcome

    def _pose(self, state: State, msg: PoseStamped, name: str) -> Pose:
        return pose_in(state.scene, msg, name, self._frames)

    # ---- the plan ---------------------------------------------------------------------------

    def _plan(self, outcome: Outcome, state: State, goals: tuple[Pose, ...],
              start: Pose | None) -> Path:
        """Plan, publish and return the trajectory of the tool frame as a Path.

        Parameters
        ----------
        outcome : Outcome
            Outcome to be filled.
        state : State
            State from which it is planned.
        goals : sequence of Pose
            Poses of one or two cut-outs.
        start : Pose or None
            Pose of the gripper now, or None.
        """
        self._store.change(lambda now: now.with_goals(goals))
        begun = monotonic()
        plan, cutouts, before = self._made(state, goals, start)
        seconds = monotonic() - begun
        scene, stamp = state.scene, self._clock.now().to_msg()
        made = Made(scene, plan, before, stamp)
        self._store.change(lambda now: now.planned(made))
        back = scene.tool.inverse()
        path = plan_path([pose.compose(back) for pose in plan.grippers], plan.times,
                         scene.frame_id, stamp)
        self._out.publish(path)
        self._picture.show('plan', lambda: markers_of_plan(
            plan, cutouts, drawn_radius(scene.direct.rod), scene.frame_id, stamp))
        self._health.plan_proved(Proof(plan))  # what was said of the plan before is over
        self._health.plan_done(plan, seconds, stamp)
        outcome.message = f'{len(plan)} gripper poses'
        outcome.values = {'waypoints': len(plan), 'seconds': seconds}
        self._reporter.info(f'planned {len(plan)} gripper poses in {1e3 * seconds:.0f} ms, '
                            f'largest miss {plan.position_error.max():.1e} m, '
                            f'smallest stability {plan.stability.min():.2f}')
        return path

    def _made(self, state: State, goals: tuple[Pose, ...],
              start: Pose | None) -> tuple[Plan, list[CutOut], Shape | None]:
        run = Run(state.scene.planning_deadline)
        with self._lock:
            if self._ended:
                raise Refused(Cause.PLANNING_CANCELED, self._ended)
            self._run = run
        try:
            with interrupted_by(run.check):
                return make_plan(state.scene, goals, start, state.shape)
        finally:
            with self._lock:
                self._run = None
