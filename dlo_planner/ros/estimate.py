# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is seen of the DLO: an estimate of it, by which motions stop, or the parameters."""

from collections import deque
from contextlib import suppress
from threading import Lock
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError, InvalidTask, NotConverged
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.correction_checks import (
    disagreement,
    expected_miss,
    misfit_reason,
    stop_before_entry,
)
from dlo_planner.execute.execution import Execution
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.estimator import DloEstimator, Swing, deviation
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.ros.inputs import Frames, pose_in
from dlo_planner.ros.lifecycle import LATEST, REQUEST
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import PlanResult, State
from dlo_planner.ros.status import Part, Shared
from dlo_planner.ros.streaming import MISS_EXPECTED, loop_task_of
from dlo_planner.settings.build import parameters_of_estimate
from dlo_planner.view.scene import estimate_primitives
from msg_helpers.clouds import points_from_cloud
from msg_helpers.poses import seconds_of

_REMEMBERED = 500    # gripper poses, until a first cloud comes
_LONGEST_AGE = 1.0  # s, after which what was seen of the DLO says nothing of it now


class Estimator(Part):
    """Hears points of the DLO, and where its cut-out is seen."""

    def __init__(self, shared: Shared, looks: Any, asking: Any) -> None:
        super().__init__(shared)
        self._turn = Lock()  # one look, or identification, after the other
        # (stamp, Pose of the tool frame)
        self._grippers: deque[tuple[float, Pose]] = deque(maxlen=_REMEMBERED)
        # Scene, DloEstimator of its DLO or None, State.resets
        self._at: tuple[Scene | None, DloEstimator | None, int] = None, None, 0
        self._identified: Estimate | None = None  # of which the parameters are being made
        # the plan whose motion is expected, by whom, State.resets
        self._moves_by: tuple[PlanResult | None, DloEstimator | None, int] = None, None, -1
        self._seen = -np.inf, np.nan  # stamp, deviation from the plan
        # center of the cut-out that was seen, as stated; stamp
        self._hole: tuple[Floats | None, float] = None, -np.inf
        node = self.node
        node.add_subscription(PointCloud2, '~/observed_points', self._on_points, LATEST, looks)
        node.add_subscription(PoseStamped, '~/observed_cutout', self._on_cutout, REQUEST, looks)
        node.add_service(Trigger, '~/identify', self._on_identify, asking)

    def gripper(self, pose: Pose, stamp: Time) -> float:
        """Take in a Pose of the tool frame; return how far the DLO is off its plan, m, or nan."""
        seconds, (scene, observing, _) = seconds_of(stamp), self._at
        self._grippers.append((seconds, pose))
        if observing is not None and scene is not None:
            observing.gripper(seconds, pose.compose(scene.tool))
        when, off = self._seen
        return off if abs(seconds - when) <= _LONGEST_AGE else np.nan

    def observing(self, stamp: Time) -> DloEstimator | None:
        """Return what observes the DLO, None where it was not looked at shortly before a stamp."""
        with self._turn:
            observing = self._observing_of(self.store.state)
        if observing is None:
            return None
        age = abs(seconds_of(stamp) - observing.looked)
        return observing if age <= max(_LONGEST_AGE, 2 * observing.seeing.period) else None

    # ---- looks ------------------------------------------------------------------------------

    def _on_points(self, msg: PointCloud2) -> None:
        with self._turn, self.status.answering(
                'observed_points', stamp=msg.header.stamp, counter='clouds refused', stream=True):
            self.statistics.count('clouds received')
            state, stamp = self.store.state, seconds_of(msg.header.stamp)
            observing = self._observing_of(state)
            if observing is None or not observing.due(stamp):
                return
            points = in_front(state.shape, points_in(state.scene, msg, 'observed_points',
                                                     self.frames))
            try:
                estimate = self._look(observing, stamp, points)
            finally:  # what no equilibrium explains is a disagreement as well
                if observing.inconsistent and state.looking is None:
                    self.store.change(lambda now: now.stopped(
                        Cause.LOOKS_DISAGREE, disagreement(observing)))
            self.statistics.note({'estimate looks': estimate.looks,
                                  'estimate misfit [m]': float(estimate.misfit),
                                  'estimate outliers': float(estimate.outliers)})
            self._draw(state, estimate, points, msg.header.stamp)
            if not state.executing:
                self._expect(state, observing)
            elif state.looking is not None:  # the closed loop sees to the rest
                self._seen = stamp, observing.off
            else:
                self._follow(state, stamp, points, observing, estimate)

    def _on_cutout(self, msg: PoseStamped) -> None:
        """Take in where the cut-out of the plan is seen; one that is seen for another begins anew.

        What was seen of the DLO is forgotten with it: the camera's error is one of both.
        """
        with self._turn, self.status.answering(
                'observed_cutout', stamp=msg.header.stamp, stream=True):
            state, stamp = self.store.state, seconds_of(msg.header.stamp)
            seen = pose_in(state.scene, msg, 'observed_cutout', self.frames).position
            observing, stated = self._observing_of(state), cutout_of(state)
            if observing is None or stated is None:
                return
            if not observing.seeing.cutout:
                raise Refused(Cause.INVALID_PARAMETER, 'observe.cutout = 0: expected how well the '
                              'place of the cut-out is known, m, or it has no effect where it is '
                              'seen')
            known, when = self._hole
            if known is not None and (known != stated).any():
                observing.reset()
            elif abs(stamp - when) < observing.seeing.period:
                return
            self._hole = stated, stamp
            observing.hole(stated, seen)

    def _look(self, observing: DloEstimator, stamp: float, points: Floats) -> Estimate:
        try:
            return observing.look(stamp, points)
        except InvalidTask as error:
            raise Refused(Cause.INVALID_POINTS, str(error)) from None

    def _draw(self, state: State, estimate: Estimate, points: Floats, stamp: Time) -> None:
        """Show the DLO as it is estimated."""
        if state.gripper is not None:
            shape, scene = estimate.shape(state.gripper), state.scene
            if shape.converged:
                self.markers.show('estimate', scene.frame_id, stamp,
                                  lambda: estimate_primitives(shape, points))

    def _observing_of(self, state: State) -> DloEstimator | None:
        """Return the DloEstimator of the DLO as it is stated; None where nothing is uncertain."""
        scene = state.scene
        scene.refuse_self_contact('an estimate')
        known, observing, resets = self._at
        kept = state.executing and state.looking is not None  # by the closed loop
        if known is None or not kept and (
                known.seeing, known.tool, known.observed.rod) != (
                scene.seeing, scene.tool, scene.observed.rod):
            observing = observing_of(scene, list(self._grippers), self._identified)
            self._identified = None
        elif resets != state.resets and observing is not None:
            observing.reset()
        self._at = known if kept else scene, observing, state.resets
        return observing

    def _expect(self, state: State, observing: DloEstimator) -> None:
        """Have the DLO expected as inertia bends it in the motion that was proved."""
        made, proof = state.planned, state.proof
        known = made, observing, state.resets
        if known == self._moves_by or made is None or proof is None or not proof.safe:
            return
        self._moves_by = known
        assert proof.report is not None and proof.report.trajectory is not None  # it is safe
        first = made.plan.shapes[0]
        with suppress(NotConverged):  # then it is expected at rest, and sways as it may
            observing.moves(Swing.of(
                proof.report.trajectory, made.scene.observed.elastic().without_obstacles(),
                first if first.parts is None else first.parts[1]), self._time_at)

    def _time_at(self, stamp: float) -> float:
        """Return the time of the motion, s, at a stamp; at rest after its end."""
        execution = self.store.state.execution
        if execution is None or self.store.state.running is not self._moves_by[0]:
            return -np.inf
        return execution.done_at(stamp) if execution.active else np.inf

    def _follow(self, state: State, stamp: float, points: Floats, observing: DloEstimator,
                estimate: Estimate) -> None:
        """Remember how far the DLO is off its plan; stop before a cut-out that it may miss."""
        execution, made = state.execution, state.running
        assert execution is not None and made is not None
        if execution.phase != 'running':
            return
        time = float(execution.way.progress([execution.done_at(stamp)])[0])
        self._seen = stamp, deviation(made.plan, time, points)
        if observing.inconsistent or not state.scene.seeing.correct:
            return
        miss, barred = judged_before_entry(made, execution, estimate)
        if np.isfinite(miss):
            self.statistics.note({MISS_EXPECTED: miss})
        if barred:
            self.store.change(lambda now: now.stopped(Cause.MISS_EXPECTED, barred))

    # ---- identification ---------------------------------------------------------------------

    def _on_identify(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._turn, self.status.answering('identify', answer=response) as outcome:
            state = self.store.state
            if state.scene.grasped is not None:
                raise Refused(Cause.INVALID_PARAMETER, 'parameter rod.grasped_at = '
                              f'{state.scene.grasped.at:g}: expected 0 for identify, the part in '
                              'front of the gripper does not tell what the whole DLO is like')
            if state.executing:
                raise Refused(Cause.EXECUTING, 'a plan is being executed: expected its end, or '
                              '~/cancel')
            observing = self._observing_of(state)
            estimate = None if observing is None else observing.estimate
            if observing is None or estimate is None or not estimate.looks:
                raise Refused(Cause.NOTHING_SEEN, 'nothing of the DLO was seen since ~/reset: '
                              'expected points on ~/observed_points, and spread.* above 0')
            wrong = misfit_reason(observing)
            if wrong:
                raise Refused(Cause.INVALID_POINTS, f'{wrong}; let the DLO hang freely, and call '
                              '~/reset')
            changed = parameters_of_estimate(estimate, state.scene.values)
            self._identified = estimate
            result = self.node.set_parameters_atomically(
                [Parameter(name, value=value) for name, value in changed.items()])
            if not result.successful:
                self._identified = None
                raise Refused(Cause.INVALID_PARAMETER, result.reason)
            self._observing_of(self.store.state)  # from now on; what was told stays told
            outcome.message = estimate_summary(estimate)
            outcome.values = {name: str(value) for name, value in changed.items()}
        return response


def judged_before_entry(made: PlanResult, execution: Execution,
                        estimate: Estimate) -> tuple[float, str]:
    """Return the miss, m, that is expected of a motion in open loop, and why it stops, '' if not.

    nan after the entry, and where nothing is passed whose room is known.
    """
    task = loop_task_of(made)
    if task is None or task.touches:  # what it misses where it touches is not predicted
        return np.nan, ''
    miss, left = expected_miss(estimate, task.estimated(made.plan), execution)
    return miss if left > 0 else np.nan, stop_before_entry(miss, task.room, left)


def cutout_of(state: State) -> Floats | None:
    """Return the center of the one cut-out of what is executed or planned, None: there is none."""
    made = state.running if state.executing else state.planned
    centers = [] if made is None else [one[0] for some in made.plan.via_points for one in some]
    if not centers or any((center != centers[0]).any() for center in centers):
        return None
    return centers[0]


def in_front(shape: Shape | None, points: Floats) -> Floats:
    """Return those of points (n, 3) that are nearer to what is in front of the gripper, m.

    Of a DLO that is grasped inside, as it is predicted: the rest is not estimated.
    """
    if shape is None or shape.parts is None:
        return points
    back, front = (np.linalg.norm(points[:, None] - part.positions, axis=2).min(axis=1)
                   for part in shape.parts)
    result: Floats = points[front <= back]
    return result


def observing_of(scene: Scene, grippers: list[tuple[float, Pose]],
                 known: Estimate | None) -> DloEstimator | None:
    """Return a new DloEstimator, None where the DLO cannot be observed or nothing is uncertain."""
    try:
        made = DloEstimator(scene.observed, scene.seeing, known)
    except InvalidTask:
        return None
    for stamp, pose in grippers:
        made.gripper(stamp, pose.compose(scene.tool))
    return made


def points_in(scene: Scene, msg: PointCloud2, name: str, frames: Frames) -> Floats:
    """Return the points (n, 3), m, of a PointCloud2 in the scene's frame."""
    origin = frames.origin(msg.header, scene.frame_id, name)
    try:
        points = points_from_cloud(msg, name)
    except DloPlannerError as error:
        raise Refused(Cause.INVALID_POINTS, str(error)) from None
    if origin is not None:
        points = points @ origin.rotation.T + origin.position
    result: Floats = points[np.linalg.norm(points, axis=1) <= scene.reach]
    return result


# Of a quantity along or about an axis: what it is called, and its unit.
_AXES = ('x', 'y', 'z')
_QUANTITIES = {
    'gripper_rotation': ('grip turned about', 'rad'),
    'gripper_position': ('grip shifted along', 'm'), 'camera': ('camera shifted along', 'm'),
    'camera_rotation': ('camera turned about', 'rad'), 'cutout': ('cut-out shifted along', 'm')}


def estimate_summary(estimate: Estimate) -> str:
    """Return in a sentence what an Estimate says: the values that were told by what was seen."""
    values, deviations = estimate.values, estimate.deviations
    prior = dict(zip(estimate.names, estimate.uncertain.deviations.tolist(), strict=True))
    said = [_said(estimate, name, values[name], deviations[name]) for name in estimate.names
            if deviations[name] < 0.7 * prior[name]]
    return (f'{estimate.looks} looks, points {1e3 * estimate.misfit:.2g} mm off, '
            f'{estimate.outliers:.0%} of them outliers: {", ".join(said) or "nothing told"}')


def _said(estimate: Estimate, name: str, value: float, deviation: float) -> str:
    """Return in words, with its unit, a number of an Estimate and its standard deviation."""
    kind, _, index = name.removesuffix(']').partition('[')
    rod, k = estimate.simulator.rod, int(index or 0)
    middle = [0.5 * rod.length]
    (twist, bend_n, bend_b), = rod.stiffnesses(middle).tolist()
    factors = {'bending_stiffness': (f'{bend_n:.3g} N m^2' if np.isclose(bend_n, bend_b) else
                                     f'{bend_n:.3g} and {bend_b:.3g} N m^2'),
               'torsional_stiffness': f'{twist:.3g} N m^2',
               'mass': f'{rod.masses_per_length(middle)[0]:.3g} kg/m'}
    if kind in factors:  # of which the number is a logarithm
        what = 'mass per length' if kind == 'mass' else kind.replace('_', ' ')
        return (f'{what} {factors[kind]} ({np.exp(value):.3g} times as stated) '
                f'+- {100 * deviation:.1g} %')
    if kind == 'length':
        return f'length {rod.length:.5g} m ({value:+.2g} m) +- {deviation:.1g} m'
    if kind == 'natural_curvature':
        term, about = divmod(k, 2)
        along = f' (P_{term} of s)' if term else ''
        return f'natural curvature about {"nb"[about]}{along} {value:+.2g} +- {deviation:.1g} 1/m'
    if kind == 'stamps':
        return f'stamps late by {value:+.2g} +- {deviation:.1g} s'
    what, unit = _QUANTITIES[kind]
    return f'{what} {_AXES[k]} by {value:+.2g} +- {deviation:.1g} {unit}'
