# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The steps of a proof, and what each of them allows: without a node."""

from types import SimpleNamespace

import numpy as np
import pytest

from dlo_planner import Limits, Plane, Pose, replay
from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.execute.causes import Cause
from dlo_planner.ros.plan import make_plan, through
from dlo_planner.ros.proof import proofs
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.worker import ProcessLost
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.obstacles import Body

VALUES = {**{name: entry.default for name, entry in PARAMETERS.items()},
          'rod.diameter': 1.5e-3, 'threading.waypoints': 12, 'threading.deepest': 0.3}
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))


def scene_with(obstacles=(), **values):
    changed = {name.replace('__', '.'): value for name, value in values.items()}
    return Scene.of({**VALUES, **changed}, {
        ('', k): Body(one) for k, one in enumerate(obstacles)})


def proved(scene, plan=None, replayed=replay):
    plan = plan or make_plan(scene, through(scene, [GOAL]), None, None)[0]
    return plan, list(proofs(replayed, scene, plan, None))


def test_slowly_first_and_then_the_motion_that_may_be_executed():
    scene = scene_with(rod__damping=[0.2, 0.0])
    plan, (slowly, moving) = proved(scene)
    assert slowly.plan is moving.plan is plan
    assert (slowly.state, slowly.done, slowly.safe) == ('held slowly', False, False)
    assert slowly.report.converged and slowly.report.trajectory is None
    assert 'ask again' in slowly.reason
    assert (moving.state, moving.done, moving.safe, moving.reason) == ('held', True, True, '')
    report, way = moving.report, moving.report.trajectory
    assert way.limits == scene.motion_limits
    assert way.tolerance == 1e-3  # the default: no size is known
    assert 0 < report.max_tracking_error <= way.tolerance and report.departure <= way.tolerance
    np.testing.assert_allclose(way.at([way.duration])[0][0].matrix, plan.grippers[-1].matrix,
                               atol=1e-9)


def test_limits_and_tolerance_are_the_parameters():
    scene = scene_with(threading__tolerance=2e-3, threading__linear_speed=0.05,
                       threading__linear_jerk=2.0, threading__angular_jerk=9.0)
    _, (_, moving) = proved(scene)
    way = moving.report.trajectory
    assert way.tolerance == moving.report.tolerance == 2e-3
    wanted = Limits(linear_speed=0.05, linear_jerk=2.0, angular_jerk=9.0)
    assert way.limits.sizes == pytest.approx(0.95 * wanted.sizes)  # the rest is for corrections


@pytest.mark.parametrize('value', [0.0, float('nan')])
def test_no_tolerance_given_is_a_quarter_of_the_room(value):
    assert scene_with(threading__tolerance=value).tolerance is None


@pytest.mark.parametrize('value', [-1e-3, 1.5, float('inf')])
def test_absurd_tolerances_are_refused_by_name(value):
    with pytest.raises(InvalidTask, match=r'threading\.tolerance'):
        scene_with(threading__tolerance=value)


def test_a_motion_that_cannot_be_made_calm_is_refused_with_the_figure_that_fails(monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)  # else it takes long
    _, (slowly, moving) = proved(scene_with(threading__tolerance=2e-5))
    assert slowly.state == 'held slowly'
    assert (moving.state, moving.done, moving.safe) == ('refused', True, False)
    assert moving.cause == Cause.NOT_CALM
    assert 'expected at most 2e-05 m; closer waypoints help' in moving.reason


def test_a_plan_that_the_dlo_does_not_follow_is_not_even_moved():
    plan = make_plan(scene_with(), through(scene_with(), [GOAL]), None, None)[0]
    other = scene_with(rod__density=12000.0)  # hangs elsewhere than planned
    asked = []
    _, (only,) = proved(other, plan, lambda **given: asked.append(given) or replay(**given))
    assert (only.state, only.done, only.safe) == ('refused', True, False)
    assert only.cause == Cause.NOT_FOLLOWED
    assert 'does not follow' in only.reason and len(asked) == 1


@pytest.mark.parametrize('kind', [DloPlannerError, RuntimeError])
def test_what_goes_wrong_is_the_reason(kind):
    def failing(**given):
        if 'limits' in given:
            raise kind('the process that proves plans has ended')
        return replay(**given)

    _, (slowly, last) = proved(scene_with(), replayed=failing)
    assert (last.state, last.done, last.safe) == ('refused', True, False)
    assert 'has ended' in last.reason and last.report is slowly.report


@pytest.mark.every(2)
@pytest.mark.parametrize(('losses', 'state'), [(1, 'held'), (3, 'held'), (4, 'refused')])
def test_a_proof_whose_process_dies_is_made_again_three_times(losses, state):
    calls = []

    def dying(**given):
        if 'limits' in given:
            calls.append(given)
            if len(calls) <= losses:
                raise ProcessLost('it has ended, status -9')
        return replay(**given)

    last = proved(scene_with(rod__damping=[0.2, 0.0]), replayed=dying)[1][-1]
    assert (last.state, last.done) == (state, True)
    assert len(calls) == min(losses + 1, 4)
    if state == 'refused':
        assert last.cause == Cause.PROOF_PROCESS and 'tried 4 times' in last.reason
        assert 'status -9' in last.reason


def test_a_search_that_takes_too_long_is_given_up():
    _, (slowly, last) = proved(scene_with(threading__deadline=0.1))
    assert (slowly.state, last.state) == ('held slowly', 'refused')
    assert 'threading.deadline = 0.1 s' in last.reason
    assert last.cause == Cause.PROOF_DEADLINE


def test_what_is_not_wanted_any_more_ends_the_proof():
    assert proved(scene_with(), replayed=lambda **given: None)[1] == []


def test_what_is_touched_on_the_way_alone_has_to_be_kept_clear_of():
    floor = Plane((0.0, 0.0, 0.5), (0.0, 0.0, 1.0))
    direct = scene_with([floor]).direct
    free = direct.solve(Pose.looking_along((0.0, 0.0, 2.5), (1.0, 0.0, 0.0)))
    lying = direct.solve(Pose.looking_along((0.0, 0.0, 0.9), (1.0, 0.0, 0.0)))
    assert lying.contacts and not free.contacts
    kept_clear = []

    def replayed(**given):
        kept_clear.append(given['obstacles'])

    for shapes in ([lying, free], [free, lying]):
        assert not list(proofs(replayed, scene_with([floor]), SimpleNamespace(shapes=shapes), None))
    assert kept_clear == [[floor], []]


def test_what_may_not_be_touched_counts_in_motion_as_well(monkeypatch):
    plan = make_plan(scene_with(), through(scene_with(), [GOAL]), None, None)[0]
    gripper = max(pose.position[2] for pose in plan.grippers)
    highest = max(shape.positions[:, 2].max() for shape in plan.shapes) + 0.75e-3
    # nearer than the rim of the hole, and planned to be so
    beside = Plane((0, 0, highest + 4e-3), (0, 0, -1))
    _, (_, moving) = proved(scene_with([beside], cutouts__radius=0.02))
    report = moving.report
    assert moving.safe and 0 < report.dynamic_clearance < report.clearance < 4.1e-3
    assert report.workspace_margin == pytest.approx(highest + 4e-3 - gripper, abs=1e-9)
    # so near that the DLO touches it in motion
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)
    near = Plane((0, 0, highest + 1e-4), (0, 0, -1))
    _, (slowly, moving) = proved(scene_with([near]))
    assert slowly.state == 'held slowly'
    assert moving.state == 'refused'
    assert 'clearance in motion' in moving.reason or 'touches' in moving.reason


@pytest.mark.sweep
def test_two_cutouts_move_calmly():
    scene = scene_with(threading__deepest=0.5)
    second = Pose.looking_along((0.25, 0.05, 0.97), (1.0, 0.0, 0.0))
    plan = make_plan(scene, through(scene, [GOAL, second]), None, None)[0]
    _, (_, moving) = proved(scene, plan)
    assert moving.safe and 0 < moving.report.max_tracking_error < 1e-3
