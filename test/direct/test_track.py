# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sweeps.shapes import random_hanging

from dlo_planner import DirectSimulator, Plane, Pose, Rod

ANGLES = [*range(0, 181, 10), *range(170, -1, -10)]


def turned(degrees):
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_benchmark_c(wire, basis):
    grippers = [turned(angle) for angle in ANGLES]
    shapes = DirectSimulator(wire, basis=basis).track(grippers)
    truth = DirectSimulator(wire, accuracy=1e-6).track(grippers)
    assert [a for a, shape in zip(ANGLES, shapes, strict=True) if shape.jumped] == [100, 80]
    for angle, shape, true in zip(ANGLES, shapes, truth, strict=True):
        assert shape.converged
        assert shape.residual < 1e-8
        if angle == 90:
            assert abs(shape.stability) < 1e-6  # neutral: it could point anywhere
            continue
        assert shape.stability > 0.05
        points = np.array([true.at(s).position for s in shape.s])
        error = np.linalg.norm(shape.positions - points, axis=1).max()
        assert error < 1e-4
        assert shape.error_estimate > error / 10


@pytest.mark.sweep
@pytest.mark.parametrize('options', [
    {'method': 'dfp'}, {'method': 'dfp', 'basis': 'local', 'n_elements': 24},
    {'method': 'downhill_simplex', 'n_elements': 16, 'n_terms': 3}])
def test_benchmark_c_with_the_papers_methods(wire, options):
    grippers = [turned(angle) for angle in ANGLES]
    shapes = DirectSimulator(wire, **options).track(grippers)
    wanted = DirectSimulator(wire, **{**options, 'method': 'newton'}).track(grippers)
    assert [a for a, shape in zip(ANGLES, shapes, strict=True) if shape.jumped] == [100, 80]
    for angle, shape, newton in zip(ANGLES, shapes, wanted, strict=True):
        assert shape.converged
        if angle != 90:  # neutral there: it could point anywhere
            np.testing.assert_allclose(shape.positions, newton.positions, atol=1e-7)


@pytest.mark.sweep
@pytest.mark.parametrize('rod', [
    Rod.circular(1.0, 0.7e-3, 8960.0, 110e9, 0.34), Rod.circular(1.0, 0.4e-3, 8960.0, 110e9, 0.34),
    Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, tip_mass=0.02), Rod(1.0, 0.1, (0.05, 50.0), 50.0)])
@pytest.mark.parametrize('options', [
    {'method': 'dfp'}, {'method': 'dfp', 'basis': 'local', 'n_elements': 48},
    {'method': 'downhill_simplex', 'n_elements': 24, 'n_terms': 3}])
def test_the_papers_methods_follow_other_dlos_too(rod, options):
    # to the tolerance of Newton's method, however soft: values drown in rounding errors long before
    grippers = [turned(angle) for angle in ANGLES[:16]]
    shapes = DirectSimulator(rod, **options).track(grippers)
    wanted = DirectSimulator(rod, **{**options, 'method': 'newton'}).track(grippers)
    for angle, shape, newton in zip(ANGLES, shapes, wanted, strict=False):
        assert shape.converged and shape.residual < 1e-9
        if angle != 90:  # neutral there: it could point anywhere
            np.testing.assert_allclose(shape.positions, newton.positions, atol=1e-7)
            assert shape.jumped == newton.jumped


@pytest.mark.sweep
def test_the_papers_description_of_strains_completes_benchmark_c(wire):
    grippers = [turned(angle) for angle in ANGLES]
    shapes = DirectSimulator(wire, method='dfp', strains='paper').track(grippers)
    assert all(shape.converged for shape in shapes)
    assert [a for a, shape in zip(ANGLES, shapes, strict=True) if shape.jumped] == [100, 80]


def pitched(degrees, roll):
    """Return a gripper that looks `degrees` down, with the strip's width rolled out of its edge."""
    turn = Rotation.from_euler('y', degrees, degrees=True)
    return Pose((0, 0, 1), (turn * Rotation.from_euler('x', 90 + roll, degrees=True)).as_quat())


@pytest.mark.parametrize('step', [10, 5, 1.7])
@pytest.mark.parametrize('load', [25, 40, 100])
def test_a_strip_that_buckles_sideways_has_jumped_once(load, step):
    # turned up from hanging, on edge: in its plane it loses its stability and takes a side
    direct = DirectSimulator(Rod(1.0, load / 9.81, (1.0, 100.0), 2.0))
    angles = np.arange(90.0, -90.1, -step)
    shapes = direct.track([pitched(angle, 0.0) for angle in angles])
    assert all(shape.converged for shape in shapes)
    flat = [abs(shape.positions[-1, 1]) < 1e-3 for shape in shapes]
    jumps = [shape.jumped for shape in shapes]
    assert jumps == [here and not after for here, after in zip([True, *flat], flat, strict=False)]
    assert sum(jumps) == 1
    index = jumps.index(True)
    alone = direct.solve(shapes[index].gripper, shapes[index - 1])
    assert alone.jumped and not direct.solve(shapes[1].gripper, shapes[0]).jumped


@pytest.mark.parametrize('step', [10, 2])
def test_a_strip_held_aslant_bends_aside_without_a_jump(step):
    # the same motion, 3 degrees off the edge: the side is given, and it goes there quickly
    direct = DirectSimulator(Rod(1.0, 25 / 9.81, (1.0, 100.0), 2.0))
    shapes = direct.track([pitched(angle, 3.0) for angle in range(90, -91, -step)])
    assert max(abs(shape.positions[-1, 1]) for shape in shapes) > 0.6
    assert not any(shape.jumped for shape in shapes)


def test_smooth_motions_do_not_jump(rng):
    # any rods, any motions: what a motion in steps a tenth as large passes without a jump
    jumps = []
    for _ in range(20):
        rod, gripper = random_hanging(rng, 1e3)
        axis = rng.normal(size=3)
        axis *= 0.15 / np.linalg.norm(axis)

        def path(parts, gripper=gripper, axis=axis):
            return [Pose.from_rotation(gripper.position, Rotation.from_rotvec(
                axis * k / parts).as_matrix() @ gripper.rotation) for k in range(8 * parts + 1)]

        direct = DirectSimulator(rod)
        jumps.append([sum(shape.jumped for shape in direct.track(path(n))) for n in (1, 10)])
    coarse, fine = np.array(jumps).T
    np.testing.assert_array_equal(coarse, fine)
    assert (fine == 0).sum() > 10


def test_a_motion_in_a_plane_leaves_no_subnormal_numbers(wire):
    shapes = DirectSimulator(wire).track([turned(-angle) for angle in range(0, 181, 5)])
    for shape in shapes:
        sizes = np.abs([*shape.frames.ravel(), *shape.positions.ravel()])
        assert not ((sizes > 0) & (sizes < 1e-200)).any()


def test_step_size_does_not_matter_while_nothing_jumps(wire):
    simulator = DirectSimulator(wire)
    fine = simulator.track([turned(angle) for angle in range(0, 81, 2)])[-1]
    coarse = simulator.track([turned(0), turned(80)])[-1]
    assert not coarse.jumped
    np.testing.assert_allclose(coarse.positions, fine.positions, atol=1e-9)


def test_jump_is_found_inside_a_large_step(wire):
    shapes = DirectSimulator(wire).track([turned(60), turned(120)])
    assert [shape.jumped for shape in shapes] == [False, True]


def test_leaf_spring_snaps_once():
    # a strip on edge bends sideways and, rolled away from that side, snaps through under its load
    rod = Rod(1.0, 3.0, (1.0, 40.0), 0.5, natural_curvature=(-4.0, 0.0))
    side = np.sign(DirectSimulator(rod).solve(Pose.identity()).positions[-1, 1])
    for sense, snaps in ((side, 1), (-side, 0)):
        rolls = sense * np.linspace(0, 2 * np.pi, 49)
        grippers = [Pose((0, 0, 0), Rotation.from_rotvec([a, 0, 0]).as_quat()) for a in rolls]
        shapes = DirectSimulator(rod).track(grippers)
        assert all(shape.converged for shape in shapes)
        assert sum(shape.jumped for shape in shapes) == snaps
        # it follows the roll then, and a whole turn ends where it began
        assert shapes[-1].energy == pytest.approx(shapes[0].energy, abs=1e-9)


def test_progress_is_told(wire):
    told = []
    DirectSimulator(wire).track([turned(a) for a in (0, 10, 20)],
                                progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_failure_is_reported_and_not_carried_on(wire):
    # with its gripper under the floor there is no shape; the next one continues the last good one
    direct = DirectSimulator(wire, basis='local', n_elements=24,
                             obstacles=[Plane((0, 0, 0.8), (0, 0, 1))])
    heights = (1.0, 0.5, 0.98)
    good, failed, again = direct.track([Pose((0, 0, z), (0, 0, 0, 1)) for z in heights])
    assert good.converged and not failed.converged
    assert again.converged and not again.jumped
    wanted = direct.track([Pose((0, 0, z), (0, 0, 0, 1)) for z in (1.0, 0.98)])[-1]
    np.testing.assert_array_equal(again.positions, wanted.positions)
