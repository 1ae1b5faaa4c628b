"""Motions against wires that were not written with the package, balances, and what they say."""

import pickle

import numpy as np
import pytest
from planar_wires import Wire, links, spectral
from scipy.spatial.transform import Rotation

from dlo_planner import Capsule, DirectSimulator, FarEnd, InvalidTask, Motion, Plane, Pose, Rod

LEVEL = Pose.identity()
DENSITY, STIFFNESS = 0.1, 0.05
# x and z of the tip in m at hundredths of a second, in benchmark C without damping: chains of 24
# and 48 bars (`planar_wires.links`), extrapolated
REFERENCE_C = {50: (0.64699, -0.40074), 100: (-0.99267, 0.11679),
               125: (0.65159, -0.38623), 150: (-0.18759, -0.39121)}


def rod(**more):
    return Rod(1.0, DENSITY, STIFFNESS, 0.04, **more)


def tilted(angle, place=(0.0, 0.0)):
    """Return a gripper turned by `angle` from x to z, at x, z."""
    return Pose((place[0], 0, place[1]), Rotation.from_euler('y', -angle).as_quat())


def turn(angle):
    """Return angle, rate and acceleration of a turn that begins and ends smoothly in 1 s."""
    def at(t):
        x = min(t, 1.0)
        return (angle * x**3 * (10 - 15 * x + 6 * x**2), angle * 30 * x**2 * (1 - x) ** 2,
                angle * 60 * x * (1 - x) * (1 - 2 * x))
    return at


def shaken(t, hertz=20.0, size=0.002):
    """Return place, velocity and acceleration of a gripper that begins to shake along z."""
    w = 2 * np.pi * hertz
    up, rate, change = size * (1 - np.cos(w * t)), size * w * np.sin(w * t), w * w * np.cos(w * t)
    return np.array([0, up]), np.array([0, rate]), np.array([0, size * change])


def still(t):
    return np.zeros(2), np.zeros(2), np.zeros(2)


# angle and place of the gripper, tip mass, s, interval s; all begin straight and level, at rest
CASES = {'swing': (lambda t: (0.0, 0.0, 0.0), still, 0.0, 0.8, 0.01),
         'whirl': (turn(np.pi), still, 0.0, 1.0, 0.01),
         'tip mass': (turn(0.7), still, 0.1, 1.0, 0.01),
         'shake': (lambda t: (0.0, 0.0, 0.0), shaken, 0.0, 0.2, 0.004)}


def motion_of(case, **options):
    angle, place, mass, seconds, interval = CASES[case]
    n = round(seconds / interval)
    times = interval * np.arange(n + 1)
    thing = rod(tip_mass=mass)
    straight = DirectSimulator(thing, gravity=(0, 0, 0), **options).solve(LEVEL)
    grippers = [tilted(angle(t)[0], place(t)[0]) for t in times]
    return DirectSimulator(thing, **options).simulate(grippers, interval, straight)


def reference(case, bars=(12, 24)):
    """Return the tips of a chain with ever more bars, and how far they may be off, m."""
    angle, place, mass, seconds, interval = CASES[case]
    times = interval * np.arange(round(seconds / interval) + 1)
    wire = Wire(1.0, DENSITY, STIFFNESS, angle, place, mass)
    coarse, fine = (links(wire, times, np.zeros(n), 1e-7) for n in bars)
    return (4 * fine - coarse) / 3, np.linalg.norm(fine - coarse, axis=1).max() / 12


def tips(motion):
    return np.array([shape.positions[-1, [0, 2]] for shape in motion.shapes])


@pytest.mark.parametrize('case', CASES)
def test_a_motion_is_right_within_its_estimate(case):
    motion = motion_of(case)
    assert motion.converged
    known, doubtful = reference(case)
    true = np.linalg.norm(tips(motion) - known, axis=1)
    assert true.max() < 5e-3 + doubtful
    assert (motion.error_estimate >= 0.1 * (true - doubtful)).all()
    assert (np.diff(motion.error_estimate) >= 0).all()
    assert motion.error_estimate[-1] < 100 * true.max() + 1e-3
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    # the work of the grips is a quadrature of its own: that it balances is no tautology
    assert np.abs(motion.numerical_loss).max() < 0.01 * moved
    assert motion.numerical_loss.min() > -2e-3 * moved


def test_both_references_agree():
    angle, place, mass, _, _ = CASES['whirl']
    wire = Wire(1.0, DENSITY, STIFFNESS, angle, place, mass)
    times = np.linspace(0, 0.3, 16)
    one, energies = spectral(wire, times, np.zeros(8), 8, 24, 1e-6)
    np.testing.assert_allclose(one, (4 * links(wire, times, np.zeros(24), 1e-7)
                                     - links(wire, times, np.zeros(12), 1e-7)) / 3, atol=5e-4)
    assert np.isfinite(energies).all()


def test_a_free_motion_keeps_its_energy():
    motion = motion_of('swing')
    np.testing.assert_array_equal(motion.work, 0)
    np.testing.assert_array_equal(motion.losses, 0)
    swung = motion.kinetic_energy.max()
    assert swung > 0.1
    assert np.abs(motion.energy - motion.energy[0]).max() < 5e-3 * swung
    assert motion.numerical_loss.min() > -1e-3 * swung


def test_what_damping_takes_is_what_is_missing():
    thing = rod(damping=(0.4, 5e-3))
    straight = DirectSimulator(thing, gravity=(0, 0, 0)).solve(LEVEL)
    motion = DirectSimulator(thing).simulate([LEVEL] * 80, 0.01, straight)
    lost = motion.energy[0] - motion.energy
    assert lost[-1] > 0.05
    np.testing.assert_allclose(motion.losses[:, 0], lost, atol=0.01 * lost[-1])
    np.testing.assert_array_equal(motion.losses[:, 1:], 0)


def test_work_of_a_gripper_that_lifts_slowly():
    heights = 0.1 * (1 - np.cos(np.pi * np.linspace(0, 1, 60)))
    motion = DirectSimulator(rod()).simulate([tilted(0, (0, z)) for z in heights], 0.2)
    assert motion.work[-1] == pytest.approx(9.81 * DENSITY * 0.2, rel=2e-3)
    assert motion.energy[-1] - motion.energy[0] == pytest.approx(motion.work[-1], rel=2e-3)


def test_the_wild_turn_of_benchmark_c_keeps_its_energy(wire):
    # 180 degrees and back within 2 s, without damping: the end cracks like a whip at 1.6 s
    times = 0.01 * np.arange(201)
    grippers = [tilted(np.pi / 2 * (1 - np.cos(np.pi * t))) for t in times[:151]]
    motion = DirectSimulator(wire).simulate(grippers, 0.01)
    assert motion.status == 'complete'
    known = np.array([REFERENCE_C[k] for k in (50, 100, 125, 150)])
    away = np.linalg.norm(tips(motion)[[50, 100, 125, 150]] - known, axis=1)
    assert away.max() < 1e-3
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert motion.numerical_loss.min() > -1e-3 * moved
    assert np.abs(motion.numerical_loss).max() < 0.01 * moved


def test_a_motion_goes_on_from_another():
    whole = motion_of('swing')
    simulator = DirectSimulator(rod())
    half = len(whole) // 2
    straight = whole.shapes[0]
    first = simulator.simulate([LEVEL] * (half + 1), 0.01, straight)
    second = simulator.simulate([LEVEL] * (len(whole) - half), 0.01, first)
    np.testing.assert_allclose(second.velocities[0], first.velocities[-1], atol=2e-2)
    np.testing.assert_allclose(tips(second)[-1], tips(whole)[-1], atol=2e-3)
    moved = np.linalg.norm(tips(whole)[-1] - tips(whole)[half])
    assert moved > 0.1


def test_an_initial_velocity_is_made_possible_or_refused():
    simulator = DirectSimulator(rod(), gravity=(0, 0, 0))
    start = simulator.solve(LEVEL)
    spin = np.array([0, -3.0, 0])
    # turned and let the gripper turn with it: a rigid rotation stays one
    grippers = [tilted(3.0 * 0.01 * k) for k in range(20)]
    motion = simulator.simulate(grippers, 0.01, start,
                                velocity=lambda s: np.cross(spin, (s, 0, 0)))
    np.testing.assert_allclose(motion.velocities[0, -1], [0, 0, 3.0], atol=1e-3)
    np.testing.assert_allclose(tips(motion)[-1], [np.cos(0.57), np.sin(0.57)], atol=2e-3)
    with pytest.raises(InvalidTask, match='velocity.*length'):
        simulator.simulate([LEVEL] * 3, 0.01, start, velocity=lambda s: (s, 0, 0))
    with pytest.raises(InvalidTask, match='velocity'):
        simulator.simulate([LEVEL] * 3, 0.01, start, velocity=np.zeros((4, 3)))


@pytest.mark.parametrize('grip', ['clamped', 'pinned', 'sleeve'])
def test_a_far_end_that_moves_slowly_is_as_in_statics(grip):
    simulator = DirectSimulator(rod(damping=(8.0, 0.02)))
    share = 0.5 - 0.5 * np.cos(np.pi * np.minimum(np.linspace(0, 1.5, 46), 1.0))
    ends = [FarEnd(tilted(-0.2 * x, (0.95 - 0.05 * x, 0.1 * x)), grip) for x in share]
    motion = simulator.simulate([LEVEL] * 46, 0.1, far_ends=ends)
    assert motion.converged, motion.message
    still = simulator.track([LEVEL] * 46, far_ends=ends)[-1]
    np.testing.assert_allclose(motion.shapes[-1].positions, still.positions, atol=2e-3)
    gained = motion.energy[-1] - motion.energy[0]
    assert motion.work[-1] == pytest.approx(gained + motion.dissipated[-1],
                                            abs=0.02 * (abs(gained) + motion.dissipated[-1]))


def test_far_ends_that_make_no_sense_are_refused():
    simulator = DirectSimulator(rod())
    held = simulator.solve(LEVEL, far_end=(0.8, 0, 0))
    for ends, named in (([(0.8, 0, 0)], 'far_ends has 1'),
                        ([(0.8, 0, 0), FarEnd(tilted(0, (0.8, 0)))], 'same grip')):
        with pytest.raises(InvalidTask, match=named):
            simulator.simulate([LEVEL] * 2, 0.01, far_ends=ends)
    with pytest.raises(InvalidTask, match='far end'):
        simulator.simulate([LEVEL] * 2, 0.01, held, far_ends=[(0.7, 0, 0)] * 2)
    assert simulator.simulate([LEVEL] * 2, 0.01, held, far_ends=[(0.8, 0, 0)] * 2).converged


@pytest.mark.parametrize('obstacle', [Plane((0, 0, -0.3), (0, 0, 1)),
                                      Capsule((0.5, -1, -0.2), (0.5, 1, -0.2), 0.02)])
def test_impacts_make_no_energy(obstacle):
    thing = rod(radius=2e-3)
    straight = DirectSimulator(thing, gravity=(0, 0, 0), n_elements=24, basis='local').solve(LEVEL)
    simulator = DirectSimulator(thing, n_elements=24, basis='local', obstacles=[obstacle])
    motion = simulator.simulate([LEVEL] * 28, 0.01, straight)
    assert any(shape.contacts for shape in motion.shapes)
    moved = motion.kinetic_energy.max()
    assert motion.converged or 's ' in motion.message
    assert motion.numerical_loss.min() > -2e-3 * moved


def test_what_stops_a_motion_is_named():
    simulator = DirectSimulator(rod(radius=2e-3, damping=1.0), n_elements=16, obstacles=[
        Plane((0, 0, -0.9), (0, 0, 1))])
    motion = simulator.simulate([tilted(0, (0, z)) for z in np.linspace(0, -1, 11)], 0.1)
    assert not motion.converged and motion.status in ('unsolved', 'energy')
    assert f'{motion.times[-1]:.3g}'[:3] in motion.message
    assert not motion.shapes[-1].converged


def test_a_motion_travels_with_its_estimate(tmp_path):
    motion = DirectSimulator(rod(), n_elements=8, n_terms=4).simulate(
        [tilted(0.01 * k) for k in range(6)], 0.01)
    motion.save(tmp_path / 'unread.npz')
    assert np.isnan(Motion.load(tmp_path / 'unread.npz').error_estimate).all()
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(again.error_estimate, motion.error_estimate)
    motion.save(tmp_path / 'read.npz')
    read = Motion.load(tmp_path / 'read.npz')
    assert read == motion
    np.testing.assert_array_equal(read.error_estimate, motion.error_estimate)
    assert motion.within_tolerance == (motion.error_estimate <= motion.tolerance).all()
