# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan that is executed in a closed loop, in simulated time and without a node."""

import time
from dataclasses import replace

import numpy as np
import pytest
from closed_loops import Touching, Truth
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Capsule,
    CutOut,
    HoldContact,
    Insert,
    NotConverged,
    Pose,
    Rod,
    SlideContact,
    Thread,
    ThreadTwo,
    Uncertainty,
    replay,
)
from dlo_planner.execute.causes import Cause
from dlo_planner.execute.guards import Enabled, Feedback
from dlo_planner.execute.limiter import frames_of, used
from dlo_planner.identify.estimator import DloEstimator
from dlo_planner.penalties import Through
from dlo_planner.ros.estimate import judged_before_entry
from dlo_planner.ros.plan import make_plan, through
from dlo_planner.ros.proof import proofs
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import PlanResult, State, Store
from dlo_planner.ros.status import Statistics
from dlo_planner.ros.streaming import closed_loop_of, loop_task_of, open_loop_warning
from dlo_planner.ros.worker import Worker
from dlo_planner.settings.parameters import PARAMETERS
from dlo_planner.tasks import MoveTo
from msg_helpers.obstacles import Body

WIRE = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
START = Pose.looking_along((-0.36, -0.1, 1.02), (1, 0, 0))
SPREAD = Uncertainty(0.05, 0.05, 0.02, natural_curvature=0.3, gripper_position=5e-4,
                     gripper_rotation=3.5e-3)
VALUES = {**{name: entry.default for name, entry in PARAMETERS.items()},
          'rod.length': 0.3, 'rod.diameter': 1e-3, 'threading.waypoints': 12,
          'threading.deepest': 0.35, 'threading.standoff': 0.02, 'threading.linear_speed': 0.1,
          'threading.angular_speed': 1.0, 'cutouts.radius': HOLE.radius, 'observe.noise': 3e-4,
          'observe.period': 0.1, 'observe.correction_period': 0.3,
          'observe.largest_correction': 0.05, 'spread.natural_curvature': 0.3,
          'spread.curvature_variation': 0.0}
LONGEST = 60.0  # s


@pytest.fixture(scope='module')
def worker():
    made = Worker('plans')
    yield made
    made.close()


@pytest.fixture(scope='module')
def proved():
    """Return a State whose plan is proved, with a gripper at its beginning."""
    state = State(Scene.of(VALUES))
    task = through(state.scene, [HOLE.pose])
    plan, before = make_plan(state.scene, task, START, None)
    state = state.with_plan(PlanResult(state.scene, plan, before, None, task, None))
    proof = list(proofs(replay, state.scene, plan, before))[-1]
    assert proof.safe
    return state.with_proof(proof).with_feedback(Feedback(START, 0.0))


class Cell:
    """A robot that follows at once, and a camera, in simulated time."""

    def __init__(self, state, worker):
        self.rng = np.random.default_rng(8)
        self.truth = Truth.drawn(self.rng, WIRE, SPREAD)
        self.observing = DloEstimator(state.scene.direct, state.scene.seeing)
        self.here, self.time, self.sent, self.phases = state.feedback.pose, 0.0, [], []
        self.start = self.here
        started = state.started(0.0)
        self.drive = closed_loop_of(started, self.observing, worker)
        self.store, self.health = Store(self.drive.begun(started)), Statistics()

    @property
    def state(self):
        return self.store.state

    def step(self):
        state = self.store.change(lambda now: now.with_feedback(Feedback(
            self.here, self.time, 0.0, self.observing.off, self.time)))
        self.observing.gripper(self.time, self.here)
        if self.observing.due(self.time):
            shape = self.truth.shape(self.here)
            points = shape.positions_at(np.linspace(0, 1, 20) * shape.s[-1])
            self.observing.look(self.time, points + 3e-4 * self.rng.standard_normal((20, 3)))
        execution = self.drive.tick(self.store, self.health, self.time, self.time)
        while self.drive._loop.work is not None:  # in another process
            time.sleep(2e-3)
        self.sent.append(execution.sending)
        if execution.sending is not None:
            self.here = execution.sending
        self.phases += [execution.phase] * (self.phases[-1:] != [execution.phase])
        self.time += state.scene.period
        return execution

    def until(self, wanted):
        """Go on until `wanted(Execution)`; return that."""
        while not wanted(execution := self.step()):
            assert self.time < LONGEST
        return execution

    def part(self):
        """Return the part of the limits that commands have used: standing still counts."""
        poses, here = [], self.start
        for sent in self.sent:
            here = here if sent is None else sent
            poses.append(here)
        scene = self.state.scene
        return used(frames_of([*poses, here, here, here]), scene.limits, scene.period)


def ended(execution):
    return not execution.active


def test_it_looks_goes_looks_again_and_threads_within_its_limits(proved, worker):
    cell = Cell(proved, worker)
    assert cell.state.executing and cell.state.execution.phase == 'waiting'
    execution = cell.until(ended)
    assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
    motion = ['waiting', 'running', 'settling']
    assert cell.phases == [*motion, *motion, 'succeeded']  # from the start, from the standoff
    assert cell.part() < 1.001
    assert cell.health.report()[2]['corrections'] >= 1
    assert cell.state.looking.miss_bound_95 < HOLE.radius
    plan = proved.planned.plan
    center, *_ = plan.via_points[-1][0]
    off = np.linalg.norm(Through(center).residuals(cell.truth.shape(cell.here)))
    assert off < cell.state.looking.miss_bound_95
    assert cell.state.planned is proved.planned  # it was executed to its end


def test_while_it_waits_nothing_is_sent_and_cancel_ends_it_there(proved, worker):
    cell = Cell(proved, worker)
    for _ in range(20):
        assert cell.step().sending is None
    cell.store.change(State.canceled)
    execution = cell.step()
    assert (execution.phase, execution.cause) == ('stopped', Cause.CANCELED)
    assert not cell.state.executing and cell.state.planned is None
    assert not execution.ends_at_once


def test_a_motion_that_is_stopped_from_outside_comes_to_rest(proved, worker):
    cell = Cell(proved, worker)
    cell.until(lambda execution: execution.phase == 'running' and execution.done > 0.4)
    cell.store.change(lambda now: now.stopped(Cause.OBSTACLES_CHANGED, 'a ball'))
    cell.store.change(lambda now: now.with_detail(Cause.OBSTACLES_CHANGED, 'a ball in the way'))
    execution = cell.step()
    assert execution.phase == 'stopping' and execution.sending is not None
    execution = cell.until(ended)
    assert (execution.phase, execution.cause) == ('stopped', Cause.OBSTACLES_CHANGED)
    assert execution.reason == 'a ball in the way'
    assert cell.part() < 1.001 and cell.state.planned is None


def test_a_correction_that_fails_lets_the_motion_come_to_rest(proved, worker):
    cell = Cell(proved, worker)
    cell.until(lambda execution: execution.phase == 'running' and execution.done > 0.4)
    cell.drive._loop._done = NotConverged('no shape')
    execution = cell.until(ended)
    assert (execution.phase, execution.cause) == ('stopped', Cause.NO_SHAPE)
    assert cell.part() < 1.001


def slipping(proved, worker):
    """Return a Cell in which the DLO has slipped on the way, at the tick that heard of it."""
    cell = Cell(proved, worker)
    cell.until(lambda execution: execution.phase == 'running' and execution.done > 0.3)
    slip = Pose((-8e-3, 0, 0), Rotation.from_rotvec((0, 0.05, 0)).as_quat())
    cell.truth = replace(cell.truth, offset=cell.truth.offset.compose(slip))
    execution = cell.until(lambda execution: cell.state.looking.tries)
    assert execution.active and execution.sending is not None
    return cell


def test_where_the_dlo_slips_it_looks_and_tries_again(proved, worker):
    cell = slipping(proved, worker)
    assert cell.state.execution.phase == 'running'  # it comes to rest, and goes on
    assert cell.state.planned is proved.planned
    cell.until(lambda execution: execution.phase == 'waiting')
    execution = cell.until(ended)
    assert execution.phase == 'succeeded', execution.reason
    assert cell.part() < 1.001


def test_what_is_canceled_on_the_way_back_comes_to_rest(proved, worker):
    cell = slipping(proved, worker)
    cell.step()
    cell.store.change(State.canceled)
    assert cell.state.execution.phase == 'stopping'
    execution = cell.step()
    assert (execution.phase, execution.cause) == ('stopping', Cause.CANCELED)
    execution = cell.until(ended)
    assert (execution.phase, execution.cause) == ('stopped', Cause.CANCELED)
    assert cell.part() < 1.001 and cell.state.planned is None


def test_what_is_barred_ends_a_motion(proved, worker):
    guards = replace(proved.scene.guards, enable_timeout=1.0)
    scene = replace(proved.scene, guards=guards)
    state = replace(proved, scene=scene).with_enabled(Enabled(True, 0.0))
    cell = Cell(state, worker)  # it was allowed once, and hears no more of it
    execution = cell.until(ended)
    assert (execution.phase, execution.cause) == ('stopped', Cause.NOT_ENABLED)
    assert 'the last one is' in execution.reason


@pytest.mark.parametrize(('room', 'planned'), [(1.2e-3, 0.3), (0.3, 1.2e-3), (0.3, 0.3)])
def test_a_motion_in_open_loop_stops_before_a_hole_that_the_dlo_may_miss(proved, room, planned):
    state, hole = proved.started(0.0), CutOut(HOLE.pose, radius=WIRE.radius + room)
    plan = proved.planned.plan  # of the room at the rim an oblique plan leaves but a part before it
    rooms = np.where(np.isfinite(plan.clearances), (room, planned, room), np.inf)
    made = replace(proved.planned, task=Thread(hole), plan=replace(plan, clearances=rooms))
    estimate = DloEstimator(state.scene.direct, state.scene.seeing).estimate  # as stated, unsure
    now, misses = 0.0, []
    while state.executing:
        now += state.scene.period
        state = state.with_feedback(Feedback(state.execution.command or START, now, stamp=now))
        state = state.after_tick(now)
        if state.execution.phase == 'running' and len(misses) < now / 0.2:  # five looks in a s
            miss, why = judged_before_entry(made, state.execution, estimate)
            misses.append(miss)
            state = state.stopped(Cause.MISS_EXPECTED, why) if why else state
    assert 1.2e-3 < np.nanmax(misses) < 0.3
    if min(room, planned) > 0.1:
        assert state.execution.phase == 'succeeded' and np.isnan(misses[-1])
        return
    assert (state.execution.phase, state.execution.cause) == ('stopped', Cause.MISS_EXPECTED)
    assert 'the room of 0.0012 m' in state.execution.reason
    tip = state.scene.direct.solve(state.execution.command).positions[-1]
    assert (tip - HOLE.center) @ HOLE.normal < 0


BAR = Capsule((0.0, -0.1, 0.98), (0.0, 0.1, 0.98), 0.02)
ON_BAR = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
ABOVE = Pose.looking_along((-0.2, 0.0, 1.24), (1.0, 0.0, 0.2))


def test_a_contact_is_held_in_a_loop_that_looks_until_it_is_touched(worker):
    scene = Scene.of({**VALUES, 'contacts.tolerance': 3e-3, 'obstacles.friction': 0.3},
                     {('cell', 1): Body(BAR)})
    task = HoldContact(ON_BAR, 0.2, 'least_force')
    plan, before = make_plan(scene, task, ABOVE, None)
    state = State(scene).with_plan(PlanResult(scene, plan, before, None, task, None))
    proof = list(proofs(replay, scene, plan, before))[-1]
    assert proof.safe, proof.reason
    assert proof.report.trajectory.duration < 10
    state = state.with_proof(proof).with_feedback(Feedback(ABOVE, 0.0))
    cell = Cell(state, worker)
    cell.truth = Touching(cell.truth, BAR)
    execution = cell.until(ended)
    assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
    assert cell.part() < 1.001
    shape = cell.truth.shape(cell.here)
    assert shape.contacts
    axes, place = shape.frame_at(0.2)
    off = axes[:, 1:].T @ (place - ON_BAR.position - (0, 0, WIRE.radius))  # across it
    assert np.linalg.norm(off) < cell.state.looking.miss_bound_95 < 3e-3
    for other in (task, SlideContact(ON_BAR, [0.2, 0.21])):
        silent = replace(state.planned, task=other, scene=Scene.of(VALUES))
        seen = DloEstimator(scene.direct, scene.seeing)
        said = open_loop_warning(replace(state, running=silent), seen)
        assert 'contacts.tolerance = 0: expected by how much' in said
        assert type(other).__name__ in said and loop_task_of(silent) is None


def test_a_plan_is_threaded_in_a_loop_where_somebody_looks_and_room_is_known(proved, worker):
    started = proved.started(0.0)
    scene = started.scene
    observing = DloEstimator(scene.direct, scene.seeing)
    assert closed_loop_of(started, None, worker) is None
    blind = DloEstimator(scene.direct, replace(scene.seeing, correct=False))
    assert closed_loop_of(started, blind, worker) is None
    made = started.running
    for narrow in (None, 0.5e-3):
        other = replace(made, task=Thread(CutOut(HOLE.pose, radius=narrow)))
        assert closed_loop_of(replace(started, running=other), observing,
                              worker) is None
    assert loop_task_of(replace(made, task=MoveTo([START]))) is None
    for other in (ThreadTwo(HOLE, HOLE), Insert(HOLE)):
        assert type(loop_task_of(replace(made, task=other)).task) is type(other)
    task = loop_task_of(made)
    assert np.allclose(task.task.cutout.center, HOLE.center)
    assert np.allclose(task.task.cutout.normal, HOLE.normal)
    depths = task.task.depths
    assert depths[0] == 0.0 and depths[-1] == pytest.approx(0.105)
    assert (np.diff(depths) > 0).all()
    assert (task.standoff, task.limits) == (0.02, scene.limits)
    without = replace(made, scene=replace(
        scene, values={**scene.values, 'threading.standoff': -1.0}))
    assert loop_task_of(without).standoff == pytest.approx(0.02, rel=1e-2)  # where the plan stops
    straight = replace(without, plan=replace(made.plan, stops=()))
    assert loop_task_of(straight).standoff == pytest.approx(0.015)


def test_a_plan_that_could_be_looked_at_and_is_not_says_so(proved):
    started = proved.started(0.0)
    scene = started.scene
    assert 'in open loop: no cloud' in open_loop_warning(started, None)
    assert open_loop_warning(started, DloEstimator(scene.direct, scene.seeing)) == ''
    seeing = replace(scene.seeing, correct=False)  # nobody wants it
    assert open_loop_warning(replace(started, scene=replace(scene, seeing=seeing)), None) == ''
    made = replace(started, running=replace(started.running, task=Thread(CutOut(HOLE.pose))))
    assert open_loop_warning(made, None) == ''  # nobody looks, nothing could be corrected
    said = open_loop_warning(made, DloEstimator(scene.direct, scene.seeing))
    assert 'in open loop' in said and 'cutout.radius = None' in said
    moved = replace(made, running=replace(made.running, task=MoveTo((HOLE.pose,))))
    said = open_loop_warning(moved, DloEstimator(scene.direct, scene.seeing))
    assert 'in open loop' in said and 'MoveTo passes no cut-out or bore, and touches' in said
