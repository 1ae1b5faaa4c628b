# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a plan has to keep."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Plan,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Workspace,
)
from dlo_planner.plan.checks import motion_margins, utilization, violated

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
STRIP = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.6, 0.4))
AHEAD = Pose.looking_along((0.2, 0.1, 1.0), (1, 0, 0))
DEPTHS = np.linspace(0, 0.9, 10)


def thread(rod=WIRE, cutout=CutOut(AHEAD), obstacles=(), **cell):  # noqa: B008  frozen
    direct = DirectSimulator(rod, obstacles=obstacles)
    return InverseSimulator(direct, **cell).thread(cutout, depths=DEPTHS)


FREE = thread()
WAY = np.array([gripper.position for gripper in FREE.grippers])


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('side', ['lower', 'upper'])
def test_the_box_names_waypoint_side_and_amount(axis, side):
    sign = 1 if side == 'upper' else -1
    corner = np.full(3, sign * np.inf)
    room = sign * (WAY[:, axis] - WAY[:, axis].mean())
    if np.ptp(room) < 1e-9:
        corner[axis] = WAY[0, axis] - sign * 0.01
        first, amount = 0, 0.01
    else:
        corner[axis] = WAY[:, axis].mean()
        first = int(np.argmax(room > 0))
        amount = room[first]
    with pytest.raises(Infeasible) as caught:
        thread(workspace=Workspace(**{side: corner}))
    error = caught.value
    assert error.constraint == f'workspace.{side}.{"xyz"[axis]}'
    assert error.waypoint == first and len(error.plan) == first
    assert error.amount == pytest.approx(amount, abs=1e-6)
    corner[axis] += sign * 1.0
    assert thread(workspace=Workspace(**{side: corner})).fraction == 1


def test_bodies_are_kept_out_of_with_the_grippers_size():
    ball = Sphere(WAY[4] + (0, 0.2, 0), 0.05)
    assert thread(workspace=Workspace(keep_out=[ball], gripper_radius=0.1)).fraction == 1
    with pytest.raises(Infeasible) as caught:
        thread(workspace=Workspace(keep_out=[Plane((0, 0, -9), (0, 0, 1)), ball],
                                   gripper_radius=0.16))
    distance = np.linalg.norm(WAY - ball.center, axis=1) - 0.05 - 0.16
    assert caught.value.constraint == 'workspace.keep_out[1]'
    assert caught.value.waypoint == int(np.argmax(distance < 0))
    assert caught.value.amount == pytest.approx(-distance[caught.value.waypoint], abs=1e-6)


def test_a_body_between_two_waypoints_is_seen():
    thin = Box(Pose(0.5 * (WAY[4] + WAY[5]), (0, 0, 0, 1)), (0.01, 0.01, 0.01))
    with pytest.raises(Infeasible) as caught:
        thread(workspace=Workspace(keep_out=[thin]))
    assert caught.value.constraint == 'workspace.keep_out[0]' and caught.value.waypoint == 5
    assert 0 < caught.value.amount <= 0.005 + 1e-12


def test_another_roll_of_a_bent_dlo_keeps_the_workspace():
    first = thread(STRIP).grippers
    side = np.sign(first[0].position[1] - 0.1)
    wall = Workspace(**{'upper' if side > 0 else 'lower': (side * np.inf, 0.1, side * np.inf)})
    plan = thread(STRIP, workspace=wall)
    assert plan.fraction == 1 and plan.position_error.max() < 1e-9
    assert all(side * (gripper.position[1] - 0.1) <= 0 for gripper in plan.grippers)


def test_obstacles_beside_the_way_are_avoided_or_named():
    aside = Capsule((-0.3, 0.4, 0.8), (-0.3, 0.6, 0.8), 0.02)
    plan = thread(obstacles=[aside])
    for one, other in zip(plan.shapes, FREE.shapes, strict=True):
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-9)
    shape = FREE.shapes[5]
    middle = shape.at(0.3).position
    with pytest.raises(Infeasible, match='Box 1') as caught:
        thread(obstacles=[aside, Box(Pose(middle, (0, 0, 0, 1)), (0.01, 0.01, 0.01))])
    assert caught.value.constraint == 'clearance' and 0 < caught.value.waypoint <= 5


def test_an_obstacle_that_has_a_name_is_called_by_it():
    middle = FREE.shapes[5].at(0.3).position
    post = Box(Pose(middle, (0, 0, 0, 1)), (0.01, 0.01, 0.01), name='post {2}')
    with pytest.raises(Infeasible, match=r'the DLO is [\d.e-]+ m in post \{2\}; .*clearance'):
        thread(obstacles=[post])
    way = Workspace(keep_out=[post])
    assert way.min_margin(Pose(middle, (0, 0, 0, 1)))[0] == 'workspace.keep_out[post {2}]'


@pytest.mark.every(3)
@pytest.mark.parametrize('size', [{'radius': 4e-3}, {'width': 8e-3, 'height': 0.02}])
@pytest.mark.parametrize('thickness', [0.0, 4e-3])
def test_clearances_against_dense_sampling(size, thickness):
    cutout = CutOut(AHEAD, **size)
    sheet = Sheet.around(cutout, 3.0, 3.0, thickness)
    plan = thread(cutout=cutout, obstacles=[sheet])
    for k in (0, 4, 9):
        shape, s = plan.shapes[k], np.linspace(0, 1, 20001)
        points = shape.positions_at(s) - cutout.center
        inside = np.abs(points[:, 0]) <= thickness / 2 + 4e-5
        away = np.abs(points[:, 1:])
        if 'radius' in size:
            rim = cutout.radius - np.linalg.norm(away, axis=1)
        else:
            rim = (np.array([cutout.width, cutout.height]) / 2 - away).min(axis=1)
        got, rooms = plan.clearances[k, 0], rim - WIRE.radius
        assert got[0] == pytest.approx(rooms[inside].min(), abs=2e-5)
        out = np.maximum(np.abs(points[:, 0]) - thickness / 2, 0)
        distance = np.where(rim > 0, np.hypot(rim, out), out) - WIRE.radius
        for part, side in ((1, points[:, 0] < -thickness / 2), (2, points[:, 0] > thickness / 2)):
            if side.sum() > 100:
                assert got[part] == pytest.approx(distance[side].min(), abs=5e-5)
    assert (plan.clearance == plan.clearances.min(axis=(1, 2))).all()
    assert plan.clearances[0, 0, 2] == np.inf or thickness  # nothing has gone through yet


def test_a_hole_too_small_is_refused():
    with pytest.raises(Infeasible) as caught:
        thread(cutout=CutOut(AHEAD, radius=0.6e-3))
    assert caught.value.constraint == 'clearance'
    assert caught.value.amount == pytest.approx(0.15e-3, rel=1e-6)


def test_the_sharpest_bend_is_kept_or_named():
    sharpest = np.array([max(1 / shape.bend_radius.min(),
                             np.linalg.norm(shape.strains[:, 1:], axis=1).max())
                         for shape in FREE.shapes])

    def limited(curvature):
        return Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, max_bend_curvature=curvature)

    plan = thread(limited(1.01 * sharpest.max()))
    np.testing.assert_allclose(plan.bend_margin, 1.01 * sharpest.max() - sharpest, rtol=1e-6)
    limit = 0.5 * (sharpest.max() + sharpest.min())
    with pytest.raises(Infeasible) as caught:
        thread(limited(limit))
    first = int(np.argmax(sharpest > limit))
    assert caught.value.constraint == 'max_bend_curvature' and caught.value.waypoint == first
    assert caught.value.amount == pytest.approx(sharpest[first] - limit, rel=1e-6)


def test_yield_is_reported_or_forbidden():
    sharpest = max(np.hypot(*shape.strains[:, 1:].T).max() for shape in FREE.shapes)
    soft = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, yield_curvature=0.8 * sharpest,
                        hardening=0.5)
    plan = thread(soft)
    assert plan.fraction == 1 and plan.yields and 'it would yield' in repr(plan)
    assert plan.yield_utilization.max() == pytest.approx(1.25, rel=1e-3)
    assert 'yield limit used' in plan.summary()
    with pytest.raises(Infeasible) as caught:
        thread(soft, allow_plastic=False)
    assert caught.value.constraint == 'yield' and 0 < caught.value.amount <= 0.251
    hard = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, yield_curvature=1.01 * sharpest)
    kept = thread(hard, allow_plastic=False)
    assert kept.fraction == 1 and not kept.yields
    assert kept.yield_utilization.max() == pytest.approx(1 / 1.01, rel=1e-3)
    assert np.isnan(FREE.yield_utilization).all() and not FREE.yields


def test_a_held_contact_says_that_the_dlo_would_yield(tmp_path):
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
    top = Pose((0.5, 0, 0.7 + 0.02), (0, 0, 0, 1))
    soft = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, yield_curvature=0.3, hardening=0.5)
    inverse = InverseSimulator(DirectSimulator(soft, basis='local', n_elements=64, obstacles=[bar]))
    plan = inverse.hold_contact(top, 0.6, forces=[0.1])
    sharpest = np.hypot(*plan.shapes[0].strains[:, 1:].T).max()
    assert plan.yields
    assert plan.yield_utilization[0] == pytest.approx(sharpest / 0.3, rel=1e-3)
    plan.save(tmp_path / 'plan.json')
    assert Plan.load(tmp_path / 'plan.json').yield_utilization == plan.yield_utilization


def test_a_held_contact_is_chosen_inside_the_workspace():
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
    direct = DirectSimulator(WIRE, basis='local', n_elements=64, obstacles=[bar])
    top = Pose((0.5, 0, 0.7 + 0.02), (0, 0, 0, 1))
    forces = np.linspace(0.02, 0.2, 10)
    whole = InverseSimulator(direct).hold_contact(top, 0.6, condition=None, forces=forces)
    heights = np.array([gripper.position[2] for gripper in whole.grippers])
    least = InverseSimulator(direct).hold_contact(top, 0.6, forces=forces)
    limit = 0.5 * (heights.min() + heights.max())
    side = 'lower' if least.grippers[0].position[2] < limit else 'upper'
    cell = Workspace(**{side: (-np.inf if side == 'lower' else np.inf,) * 2 + (limit,)})
    kept = InverseSimulator(direct, workspace=cell).hold_contact(top, 0.6, forces=forces)
    assert (kept.grippers[0].position[2] > limit) == (side == 'lower')
    with pytest.raises(Infeasible, match='none of') as caught:
        InverseSimulator(direct, workspace=Workspace(upper=(np.inf, np.inf, 0.0))).hold_contact(
            top, 0.6, forces=forces)
    assert caught.value.constraint == 'workspace.upper.z'
    assert caught.value.amount == pytest.approx(heights.min(), abs=1e-6)


def test_a_workspace_without_room_is_refused():
    with pytest.raises(InvalidTask, match=r'Workspace\.upper'):
        Workspace(lower=(1, 0, 0), upper=(0, 1, 1))


def test_curvature_yields_by_the_ellipse_whatever_the_roll():
    # rolled by 45 degrees the bend is shared by both axes: each below its limit, not both together
    sharpest = max(np.hypot(*shape.strains[:, 1:].T).max() for shape in FREE.shapes)

    def outcome(limit, roll):
        rod = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, yield_curvature=limit * sharpest,
                           hardening=0.5)
        start = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec([roll, 0, 0]).as_matrix())
        inverse = InverseSimulator(DirectSimulator(rod), allow_plastic=False)
        try:
            return inverse.thread(CutOut(AHEAD), start=start, depths=DEPTHS)
        except Infeasible as error:
            return error

    for roll in (0.0, 0.6, np.pi / 4, np.pi / 2):
        assert outcome(1.001, roll).fraction == 1
        refused = outcome(0.9, roll)
        assert refused.constraint == 'yield'
        share = max(np.hypot(*shape.strains[:, 1:].T).max()
                    for shape in FREE.shapes[:refused.waypoint + 1])
        assert refused.amount == pytest.approx(share / (0.9 * sharpest) - 1, rel=1e-3)


def test_a_rectangle_yields_at_its_corners():
    # bent about both axes it yields where the stress at a corner does, before either side would
    rod = Rod.rectangular(1.0, 2e-3, 1e-3, 8960.0, 110e9, 0.34, yield_stress=60e6)
    limits = np.array([rod.yield_torsion, *rod.yield_curvature])
    elastic = DirectSimulator(rod).elastic()
    for roll in (0.0, 0.5, 1.2, np.pi / 2):
        gripper = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec([roll, 0, 0]).as_matrix())
        shape = elastic.solve(gripper)
        assert utilization(shape, limits) == pytest.approx(shape.surface_stress[:, 0].max() / 60e6)


def test_a_twisted_dlo_yields_at_its_torsion():
    # straight between two grips: its torsion is the angle over the length
    twisted = Pose.from_rotation((1, 0, 0), Rotation.from_rotvec([0.5, 0, 0]).as_matrix())
    shape = DirectSimulator(WIRE, gravity=(0, 0, 0)).solve(Pose.identity(), far_end=twisted)
    assert utilization(shape, np.array([0.8, 2.0, 2.0])) == pytest.approx(0.5 / 0.8, rel=1e-6)


def test_each_axis_yields_at_its_own_limit():
    # bent about n alone, the limit of the other axis and of torsion do not matter
    sharpest = max(np.hypot(*shape.strains[:, 1:].T).max() for shape in FREE.shapes)
    fixed = {'length': 1.0, 'diameter': 1.5e-3, 'density': 8960.0, 'youngs_modulus': 110e9,
             'poisson_ratio': 0.34, 'hardening': 0.5}
    for limits, refused in (((1.01, 0.01), False), ((0.9, 10.0), True)):
        rod = Rod.circular(**fixed, yield_curvature=tuple(k * sharpest for k in limits),
                           yield_torsion=1e-3 * sharpest)
        inverse = InverseSimulator(DirectSimulator(rod), allow_plastic=False)
        if refused:
            with pytest.raises(Infeasible) as caught:
                inverse.thread(CutOut(AHEAD), depths=DEPTHS)
            assert caught.value.constraint == 'yield'
        else:
            assert inverse.thread(CutOut(AHEAD), depths=DEPTHS).fraction == 1


CALM = {'converged': True, 'position_error': 3e-3, 'clearance': 8e-3, 'calm_clearance': 9e-3,
        'departure': 1e-3, 'contact_force': 0.0, 'contact_lost': np.nan, 'bend_margin': np.nan}


@pytest.mark.parametrize(('figures', 'broken', 'used'), [
    ({}, None, 0.5), ({'departure': 3e-3}, 'departure', 1.5),
    ({'position_error': 6e-3}, 'miss', 2.0), ({'clearance': 5.5e-3}, 'clearance', 3.5 / 2.25),
    ({'clearance': -4e-3}, 'clearance', 13 / 2.25), ({'contact_force': 0.1}, 'contact', 2.0),
    ({'contact_lost': 0.1}, 'contact', 2.0), ({'bend_margin': -0.1}, 'max_bend_curvature', 2.0),
    ({'converged': False}, 'motion', np.inf)])
def test_a_calm_motion_keeps_its_room_and_comes_to_rest(figures, broken, used):
    margins = motion_margins(CALM | figures, planned_miss=2e-3, tolerance=2e-3, touches=False,
                             room=0.01)
    first = violated(margins)
    assert (first and first.name) == broken
    assert max(one.used for one in margins) == pytest.approx(used)
    assert first is None or first.used > 1 and '{' not in first.message
    units = {'contact_force': 'N', 'contact_lost': '', 'bend_margin': '1/m', 'converged': ''}
    assert first is None or first.unit == units.get(next(iter(figures)), 'm')
    # that a motion is calm is asked for where it is made, and the room it may lose is not small
    moved = motion_margins(CALM | figures, planned_miss=2e-3, tolerance=2e-3, touches=False)
    assert {one.name for one in moved} <= {one.name for one in margins}
    wide = motion_margins(CALM | {'clearance': 0.79, 'calm_clearance': 1.0}, 2e-3, 2e-3, False, 1.0)
    assert violated(wide) is None
