# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan on the page: with callbacks alone, and in a browser."""

import sys

import numpy as np
import pytest
from browser import dragged_to, looking_at

from dlo_planner import (
    Box,
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
)
from dlo_planner.view import view
from dlo_planner.view.pages import Replanner, cutouts_of
from dlo_planner.view.viser import eye, pose_of

pytest.importorskip('viser', reason='extra [view] is not installed')

WIRE = Rod.circular(1.0, 3e-3, 8960.0, 110e9, 0.34, max_bend_curvature=4.0)
HOLE = CutOut(Pose.looking_along((0.6, 0.2, 0.9), (1, 0.6, 0)), radius=0.02)
POST = Box(Pose((0.5, -0.35, 0.8), (0, 0, 0, 1)), (0.1, 0.1, 0.4))


@pytest.fixture(scope='module')
def inverse():
    return InverseSimulator(DirectSimulator(WIRE, n_elements=32, n_terms=8, obstacles=[POST]))


@pytest.fixture(scope='module')
def plan(inverse):
    return inverse.thread(HOLE, depths=np.linspace(0, 0.9, 12))


@pytest.fixture
def page(plan, inverse):
    shown = view(plan, inverse, port=18_400)
    yield shown
    shown.close()


def drawn(page, group):
    return [item for name, item in page.page.canvas.items.items() if name[0] == group]


@pytest.mark.sweep
def test_the_slider_shows_the_waypoint_whose_time_has_come(page, plan):
    assert repr(page) == f'PlanPage({page.url})' and page.url.startswith('http://')
    for time, index in ((0.0, 0), (plan.times[5] + 0.01, 5), (page.time.max, 11)):
        page.time.value = float(time)
        np.testing.assert_array_equal(drawn(page, 'dlo')[0].points, plan.shapes[index].positions)
        np.testing.assert_allclose(pose_of(page.gripper).matrix, plan.grippers[index].matrix,
                                   atol=1e-9)
        assert f'waypoint {index + 1} of 12' in page.table.content
    assert page.time.max >= plan.times[-1]


@pytest.mark.sweep
def test_a_dragged_gripper_takes_the_dlo_along(page, plan, inverse):
    pose = Pose(plan.grippers[0].position + (0.02, 0.05, 0.1), plan.grippers[0].quaternion)
    dragged_to(page.gripper, pose)
    assert page.settle()
    expected = inverse.simulator.track([pose], initial=plan.shapes[0])[0]
    np.testing.assert_allclose(drawn(page, 'dlo')[0].points, expected.positions, atol=1e-9)
    page.time.value = float(plan.times[3])
    np.testing.assert_array_equal(drawn(page, 'dlo')[0].points, plan.shapes[3].positions)


@pytest.mark.sweep
def test_a_dragged_cut_out_is_planned_anew(page):
    target = Pose.looking_along((0.7, 0.0, 0.85), (1, 0, 0.2))
    dragged_to(page.cutout, target)
    assert page.settle()
    assert 'ok:' in page.message.content and page.plan.position_error.max() < 1e-6
    center, _, normal = page.plan.via_points[-1][0]
    np.testing.assert_allclose(center, target.position)
    np.testing.assert_allclose(normal, target.direction, atol=1e-9)
    np.testing.assert_allclose(drawn(page, 'cutout')[0].pose.matrix, target.matrix, atol=1e-9)
    np.testing.assert_allclose(pose_of(page.gripper).matrix, page.plan.grippers[0].matrix,
                               atol=1e-9)


@pytest.mark.sweep
def test_a_plan_may_begin_at_the_gripper(page, plan):
    pose = Pose.looking_along(plan.grippers[0].position - (0.2, 0.1, 0), (1, 0.3, 0))
    dragged_to(page.gripper, pose)
    assert page.settle()
    page.whole.value = True
    assert page.settle()
    assert len(page.plan) > len(plan), page.message.content
    np.testing.assert_allclose(page.plan.grippers[0].matrix, pose.matrix, atol=1e-9)
    assert page.time.max == pytest.approx(page.plan.times[-1], abs=0.01)


@pytest.mark.sweep
def test_a_refusal_is_said_and_the_plan_stays(page, plan):
    dragged_to(page.cutout, Pose.looking_along((0.5, -0.35, 0.8), (0, 0, 1)))  # inside the post
    assert page.settle()
    assert 'error:' in page.message.content and 'refused' in page.message.content
    assert page.plan == plan
    dragged_to(page.gripper, Pose((1e3, 0, 0), (0, 0, 0, 1)))
    assert page.settle()


@pytest.mark.sweep
def test_what_cannot_be_planned_anew_is_only_shown(plan, tmp_path):
    plan.save(tmp_path / 'plan.npz')
    shown = view(Plan.load(tmp_path / 'plan.npz'), port=18_400)
    try:
        assert 'to be looked at only' in shown.message.content
        shown.time.value = shown.time.max
        assert drawn(shown, 'dlo') and drawn(shown, 'ghost')
        assert not hasattr(shown, 'gripper')
    finally:
        shown.close()


@pytest.mark.sweep
def test_it_needs_no_more_than_a_plan(plan):
    replanner = Replanner.of(plan)
    assert replanner.inverse.simulator.rod == WIRE
    again = replanner.plan(HOLE, plan.grippers[0], False, None)
    # on another mesh: within the accuracy of 1e-3 of the length
    np.testing.assert_allclose(again.grippers[-1].matrix, plan.grippers[-1].matrix, atol=1e-3)
    assert cutouts_of(plan) == [HOLE]


@pytest.mark.parametrize(('name', 'value'), [
    ('plan', None), ('plan', 'a'), ('inverse', 3), ('color', 'rainbow'), ('port', 0),
    ('port', 99_999), ('host', 3), ('host', '203.0.113.7'), ('host', 'no such machine')])
def test_odd_arguments_are_refused_by_name(plan, name, value):
    with pytest.raises(InvalidTask, match=f'{name} = '):
        view(**{'plan': plan, name: value})


def test_without_viser_the_extra_is_named(plan, monkeypatch):
    monkeypatch.setitem(sys.modules, 'viser', None)
    with pytest.raises(ModuleNotFoundError, match=r'dlo_planner\[view\]'):
        view(plan)


@pytest.mark.parametrize('size', [(1, 1, 1), (3, 0.1, 0.2), (0.1, 0.1, 4), (0, 2, 0)])
def test_the_camera_sees_all_corners(size):
    low, high = np.array((1.0, 2.0, 3.0)), np.array((1.0, 2.0, 3.0)) + size
    place = eye(low, high)
    forward = 0.5 * (low + high) - place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    corners = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1])
                        for z in (low[2], high[2])]) - place
    seen = np.column_stack([corners @ right / 0.95, corners @ np.cross(right, forward)])
    slopes = np.abs(seen / (corners @ forward)[:, None])
    assert slopes.max() == pytest.approx(np.tan(np.deg2rad(25)))


@pytest.mark.sweep
def test_nobody_can_share_it(page):
    assert page.page.server.request_share_url() is None
    assert page.url == 'http://localhost:' + page.url.rsplit(':', 1)[1]


@pytest.mark.sweep
def test_in_the_browser(page):
    with looking_at(page.url) as look:
        look.wait_for('drag the gripper or the cut-out')
        look.wait_for('curvature: 0 to 4 1/m (limit)')
        empty = np.ones_like(look.picture())
        assert look.changed(empty) > 0.01
        assert look.colors() > 500
        before = look.picture()
        page.time.value = float(page.plan.times[8])
        assert look.changed(before) > 1e-3
        look.wait_for('waypoint 9 of 12')
        slider = look.page.get_by_role('slider').first
        slider.press('Home')
        look.wait_for('waypoint 1 of 12')
        before = look.picture()
        dragged_to(page.cutout, Pose.looking_along((0.7, 0.0, 0.85), (1, 0, 0.2)))
        look.wait_for('planned 12 waypoints')
        assert look.changed(before) > 1e-3
        assert look.complaints == []
