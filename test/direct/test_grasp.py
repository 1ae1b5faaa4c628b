# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Grasped inside: what both parts say is said of the whole, in the whole's arc length."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, DirectSimulator, InvalidTask, Pose, Rod
from dlo_planner.direct.grasp import grasped_at, held_as
from dlo_planner.plan.checks import utilization
from dlo_planner.plan.continuity import same
from dlo_planner.rods import GraspedInside

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


def test_contacts_are_where_they_say(wire):
    bars = [Capsule((x, -0.5, 0.965), (x, 0.5, 0.965), 0.02) for x in (-0.25, 0.3)]
    shape = GraspedInside(wire, 0.4, basis='local', obstacles=bars).solve(LEVEL)
    assert shape.converged and {contact.obstacle for contact in shape.contacts} == {0, 1}
    places = [contact.s for contact in shape.contacts]
    assert places == sorted(places) and places[0] < 0.4 < places[-1]
    for contact in shape.contacts:
        np.testing.assert_allclose(shape.at(contact.s).position, contact.position, atol=1e-9)
        assert abs(contact.position[0] - (-0.25, 0.3)[contact.obstacle]) < 0.05


def test_one_part_that_jumps_is_a_jump(wire):
    # the back part goes through benchmark C, the other one is too short to notice
    grasped = GraspedInside(wire, 0.9)
    ways = [Pose((0, 0, 1), (Rotation.from_euler('y', 180 - angle, degrees=True)).as_quat())
            for angle in (60, 120)]
    shapes = grasped.track(ways)
    assert [[part.jumped for part in shape.parts] for shape in shapes] == [
        [False, False], [True, False]]
    assert [shape.jumped for shape in shapes] == [False, True]
    assert shapes[1].energy == pytest.approx(sum(part.energy for part in shapes[1].parts))


def test_the_worse_part_tells_residual_and_error(curly):
    shape = GraspedInside(curly, 0.3, n_elements=24).solve(LEVEL)
    back, on = shape.parts
    assert shape.residual == max(back.residual, on.residual)
    assert shape.stability == min(back.stability, on.stability)
    assert shape.error_estimate == max(back.error_estimate, on.error_estimate)
    assert back.error_estimate != on.error_estimate


def test_a_load_that_varies_is_that_of_the_whole():
    # only what lies beyond 0.7 m is loaded: the back part does not notice, the other one does
    rod = Rod(1.0, 0.0, 1.0, 0.7)
    grasped = GraspedInside(rod, 0.5, basis='local', gravity=(0, 0, 0),
                            load=lambda s: (0, 0, -1.0 if s > 0.7 else 0.0))
    shape = grasped.solve(LEVEL)
    back, on = shape.parts
    np.testing.assert_allclose(back.element_strains, 0, atol=1e-12)
    assert on.gripper_wrench[2] == pytest.approx(0.3, rel=0.03)
    alone = DirectSimulator(Rod(0.5, 0.0, 1.0, 0.7), basis='local', gravity=(0, 0, 0),
                            load=lambda s: (0, 0, -1.0 if s > 0.2 else 0.0)).solve(LEVEL)
    np.testing.assert_allclose(on.positions, alone.positions, atol=1e-12)


def test_losses_and_violations_are_those_of_both_parts():
    yields = Rod(1.0, 0.3, 0.05, 0.04, yield_curvature=0.5, hardening=0.1)
    shape = GraspedInside(yields, 0.4, basis='local').solve(LEVEL)
    back, on = shape.parts
    assert 0 < back.dissipated < on.dissipated
    assert shape.dissipated == back.dissipated + on.dissipated
    thick = Rod(1.0, 0.1, 0.5, 0.4, radius=0.01)
    for x in (-0.35, 0.35):  # a block in which one of the parts lies, and cannot get out
        block = Box(Pose((x, 0, 1), (0, 0, 0, 1)), (0.3, 2.0, 2.0))
        shape = GraspedInside(thick, 0.5, basis='local', n_elements=16,
                              obstacles=[block]).solve(LEVEL)
        assert not shape.converged
        assert shape.violation == max(part.violation for part in shape.parts) > 0.01


# ---- as one DLO ----------------------------------------------------------------------------------

SOFT = Rod(1.0, 0.045, 0.0147, 0.0118, radius=2.25e-3)
ASIDE = Pose.looking_along((0.1, -0.2, 1), (1, 0.4, 0.3))


def alone(rod, pose, **options):
    """Return the Shapes of two DLOs, to the beginning and to the end, each held at its own."""
    back, on = (DirectSimulator(replace(rod, length=length), **options) for length in (0.65, 0.35))
    turned = Pose.from_rotation(pose.position, pose.rotation @ np.diag([-1.0, 1.0, -1.0]))
    return back.solve(turned), on.solve(pose)


def test_the_whole_is_two_dlos_each_held_by_itself():
    shape = GraspedInside.of(DirectSimulator(SOFT), 0.65).solve(ASIDE)
    assert shape == GraspedInside(SOFT, 0.65).solve(ASIDE)
    back, on = alone(SOFT, ASIDE)
    np.testing.assert_allclose(shape.positions, np.vstack([back.positions[:0:-1], on.positions]),
                               rtol=0, atol=1e-15)
    np.testing.assert_allclose(shape.gripper_wrench, back.gripper_wrench + on.gripper_wrench,
                               rtol=0, atol=1e-12)
    assert shape.s[0] == 0 and shape.s[-1] == SOFT.length
    np.testing.assert_allclose(shape.at(0.65).matrix, ASIDE.matrix, atol=1e-12)


def test_the_gripper_bears_the_weight_where_it_hangs():
    shape = GraspedInside(SOFT, 0.65, n_elements=200, basis='local').solve(ASIDE)
    s = np.linspace(0, 1, 4001)
    middle = 0.5 * (s[1:] + s[:-1])
    weight = np.array([0, 0, -0.045 * 9.81])
    arms = shape.positions_at(middle) - ASIDE.position
    np.testing.assert_allclose(shape.gripper_wrench, -np.concatenate(
        [weight, np.cross(arms, weight).mean(axis=0)]), rtol=0, atol=2e-5)


def test_it_knows_its_dlo_and_the_bend_that_the_gripper_makes_of_each_part():
    limited = replace(SOFT, max_bend_curvature=12.0, yield_curvature=20.0)
    shape = GraspedInside(limited, 0.65, n_elements=400, basis='local').solve(LEVEL)
    back, on = shape.parts
    assert shape.rod == limited and shape.obstacles == ()
    # M / EI of the longer part, which weighs on the gripper's edge
    bend = abs(back.gripper_wrench[4]) / 0.0147
    assert shape.bend_margin == pytest.approx(12.0 - bend, abs=0.01)
    assert shape.bend_margin == back.bend_margin < on.bend_margin - 1
    limits = np.array([np.inf, 20.0, 20.0])
    assert utilization(shape, limits) == pytest.approx(bend / 20, abs=1e-3)
    np.testing.assert_allclose(shape.bent, shape.element_strains)


def test_the_set_of_each_part_is_its_own():
    yields = Rod(1.0, 0.3, 0.05, 0.04, yield_curvature=0.5, hardening=0.1)
    shape = GraspedInside(yields, 0.4, basis='local').solve(LEVEL)
    back, on = shape.parts
    assert back.dissipated > 0 and on.dissipated > 0
    np.testing.assert_array_equal(shape.bent[-len(on.bent):], on.bent)
    np.testing.assert_array_equal(shape.bent[:len(back.bent), 1], -back.bent[::-1, 1])
    assert np.abs(shape.bent - shape.element_strains).max() > 0.01


def test_what_is_moved_or_comes_from_a_file_has_its_parts(tmp_path):
    grasped = GraspedInside(SOFT, 0.65)
    shape = grasped.solve(ASIDE)
    away = np.array([0.0, 0.3, 0.1])
    for one, other in zip(shape.moved(away).parts, shape.parts, strict=True):
        np.testing.assert_allclose(one.positions, other.positions + away, atol=1e-15)
    for name in ('shape.npz', 'shape.json'):
        shape.save(tmp_path / name)
        loaded = type(shape).load(tmp_path / name)
        assert grasped_at(loaded) == 0.65
        for one, other in zip(loaded.parts, shape.parts, strict=True):
            np.testing.assert_array_equal(one.positions, other.positions)
        there = grasped.solve(LEVEL, loaded)
        assert there.converged and same(there, grasped.solve(LEVEL, shape))
    assert grasped_at(DirectSimulator(SOFT).solve(LEVEL)) is None


def test_one_part_that_passes_through_the_other_is_said():
    # coils of either hand, of more than a turn: which end lies before the other changes
    coils = [GraspedInside(Rod(1.0, 0.01, 1.0, 0.7, natural_curvature=(0, 2.2 * np.pi),
                               natural_twist=twist, radius=1e-3), 0.5, gravity=(0, 0, 0))
             for twist in (0.6, -0.6)]
    one, other = (coil.solve(LEVEL) for coil in coils)
    assert one.converged and other.converged and one.lies_in_itself is False
    assert coils[0].track([LEVEL], initial=one)[0].passed_itself is False
    there = coils[1].track([LEVEL], initial=one)[0]
    assert same(there, other) and there.passed_itself is True
    assert all(part.passed_itself is False for part in there.parts)


def test_a_motion_is_that_of_both_parts():
    ways = [Pose((0.1 * np.sin(t) ** 2, 0, 1), (0, 0, 0, 1))
            for t in np.linspace(0, np.pi, 31)]
    grasped = GraspedInside(SOFT, 0.65)
    motion = grasped.simulate(ways, 0.03)
    assert motion.converged and motion.status == 'complete' and len(motion.shapes) == 31
    turned = [Pose.from_rotation(way.position, way.rotation @ np.diag([-1.0, 1.0, -1.0]))
              for way in ways]
    back, on = (DirectSimulator(replace(SOFT, length=length)).simulate(way, 0.03)
                for length, way in ((0.65, turned), (0.35, ways)))
    np.testing.assert_allclose(motion.shapes[20].positions, np.vstack(
        [back.shapes[20].positions[:0:-1], on.shapes[20].positions]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(motion.velocities[20], np.vstack(
        [back.velocities[20][:0:-1], on.velocities[20]]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(motion.energy, back.energy + on.energy, rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.work, back.work + on.work, rtol=0, atol=1e-12)
    # it goes on from where it is, at its speed
    rest = grasped.simulate([ways[-1]] * 2, 0.03, motion)
    np.testing.assert_allclose(rest.velocities[0], motion.velocities[-1], rtol=0, atol=2e-3)
    assert np.abs(rest.velocities[0]).max() > 0.05


def test_a_motion_ends_for_both_where_one_part_cannot_go_on():
    wall = Box(Pose((-0.3, 0, 1), (0, 0, 0, 1)), (0.02, 2, 2))
    grasped = GraspedInside(SOFT, 0.35, obstacles=[wall], n_elements=8, basis='local')
    ways = [Pose((x, 0, 1), (0, 0, 0, 1)) for x in np.linspace(0.2, -0.5, 8)]
    motion = grasped.simulate(ways, 0.1, tolerance=np.inf)
    assert not motion.converged and motion.status != 'complete'
    assert motion.message.startswith('the part before the gripper: ')
    assert len(motion) < 8 and len(motion.shapes) == len(motion.velocities) == len(motion)


def test_another_place_is_refused_by_name():
    grasped = GraspedInside(SOFT, 0.65)
    with pytest.raises(InvalidTask, match='initial = .*: expected .* at 0.65 m, it is held at 0.4'):
        grasped.solve(LEVEL, GraspedInside(SOFT, 0.4).solve(LEVEL))
    with pytest.raises(InvalidTask, match='simulator holds the DLO at 0.65 m: expected 0.4 m'):
        held_as('simulator', grasped, GraspedInside(SOFT, 0.4).solve(LEVEL))
    with pytest.raises(InvalidTask, match='simulator.grip = \'pinned\''):
        GraspedInside.of(DirectSimulator(SOFT, grip='pinned'), 0.4)
    for at in (0.0, 1.0):
        with pytest.raises(InvalidTask, match='at = .*: expected a finite number > 0 and < 1'):
            GraspedInside.of(DirectSimulator(SOFT), at)
    for direction, said in ((0, '0: expected 1, to the end, or -1'), (2, '2: expected')):
        with pytest.raises(InvalidTask, match=f'direction = {said}'):
            DirectSimulator(SOFT).part(0.5, direction)
    yields = Rod(1.0, 0.3, 0.05, 0.04, yield_curvature=0.5, hardening=0.1)
    whole = DirectSimulator(yields)
    with pytest.raises(InvalidTask, match='expected one without a permanent set .* at 0.5 m'):
        whole.with_set(whole.solve(LEVEL)).part(0.5, 1)


@pytest.mark.parametrize('options', [{}, {'n_elements': 24, 'n_terms': 6}, {'accuracy': 1e-3},
                                     {'basis': 'local', 'n_elements': 30}, {'basis': 'fourier'}])
def test_a_part_is_meshed_as_a_dlo_of_its_own(options):
    part = DirectSimulator(SOFT, **options).part(0.65, 1)
    assert part == DirectSimulator(replace(SOFT, length=0.35), **options)
