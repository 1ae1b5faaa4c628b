import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod

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


def test_bad_poses_are_named(wire):
    with pytest.raises(InvalidTask, match="gripper = 'here'"):
        DirectSimulator(wire).track([turned(0), 'here'])


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
