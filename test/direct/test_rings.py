# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""DLOs that slide through rings and tubes: which places are in them, and against what friction."""

import numpy as np
import pytest
from references.rings import shot
from scipy.special import beta

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Hold,
    InvalidTask,
    Plane,
    PointLoad,
    Pose,
    Rod,
    solve_many,
)
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.sliding import answers_at, material_slope, stretched
from dlo_planner.direct.statics import StepInputs, step
from dlo_planner.model.holds import posed
from dlo_planner.model.pose import displaced
from dlo_planner.model.value import changed

toward = Pose.looking_along
CABLE = Rod(0.62, 0.03, 2e-3, 1.6e-3, radius=0.003)
CLIPS = toward((0.30, 0.12, 0), (-1, 0.1, 0)), toward((0.12, 0.10, 0), (-0.8, -0.6, 0))
PLUG = FarEnd(toward((0, -0.02, 0), (-0.3, -1, 0)))
HERE = toward((0.42, 0.2, 0.03), (-1, -0.5, 0))


def board(grip='tube', slip=0.0, **options):
    """Return a simulator, and what holds its DLO: two clips and a connector."""
    simulator = DirectSimulator(CABLE, **({'n_elements': 32, 'basis': 'local'} | options))
    return simulator, [Hold(pose, grip, s, slip, by=f'clip {k}')
                       for k, (pose, s) in enumerate(zip(CLIPS, (0.2, 0.4), strict=True))] + [PLUG]


def pulled(by):
    """Return the gripper's pose that far on, m."""
    return toward((0.42 + 0.78 * by, 0.2 + 0.62 * by, 0.03), (-1, -0.5, 0))


def places(shape):
    return np.array([hold.s for hold in shape.holds if hold.is_ring])


def taut(by):
    """Return the Shape of a DLO in two forks, whose gripper has drawn it on by so many m."""
    forks = [Hold(toward((0.305, 0.047, 0.1), (-0.98, -0.2, 0)), 'ring', 0.4515, 0.07),
             Hold(toward((0.183, 0.0227, 0.1), (-0.98, -0.18, 0)), 'ring', 0.5759, 0.18),
             FarEnd(toward((0, 0, 0.1), (-1, 0, 0)))]
    simulator = DirectSimulator(Rod(0.76, 0.03, 7.4e-3, 2e-3), n_elements=64, basis='local')
    here = Pose((0.733, 0.183, 0.1275), (-0.0047, 0.0722, 0.9839, -0.1635))
    begin = simulator.solve(here, holds=forks)
    there = Pose(here.position + by * np.array([0.95, 0.3, 0.05]), here.quaternion)
    return simulator.track([there], initial=begin, holds=begin.holds)[0]


def test_a_taut_part_between_rings_answers_alike_to_both_sides():
    # second derivatives of one energy: where steps are no small part of 12 um of slack they are not
    shape = taut(6e-4)
    stiffness = shape.state.feed.stiffness
    assert shape.converged and np.isfinite(stiffness).all()
    np.testing.assert_allclose(stiffness, stiffness.T, rtol=2e-4)
    assert np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))[0] > 0


# ---- against what others know ---------------------------------------------------------------


def test_a_released_tube_pushes_as_bigonis_does():
    # Bigoni, Dal Corso, Bosi and Misseroni (2013): out of a tube without friction comes the force
    # M^2 / 2 EI along it. Pinned at its other end, where it has to point across the DLO then, that
    # DLO is Euler's rectangular elastica: a quarter of it spans a B(3/4, 1/2) / 2 along the force
    # F = EI / 2 a^2, 2 a across it, with a length of a B(1/4, 1/2) / 2
    stiff, a = 0.01, 0.1
    force, length = stiff / (2 * a * a), 0.5 * a * beta(0.25, 0.5)
    simulator = DirectSimulator(Rod(0.6, 0.0, stiff, 0.008), n_elements=128, basis='local',
                                gravity=(0, 0, 0), grip='pinned')
    pin = toward((-0.5 * a * beta(0.75, 0.5), 2 * a, 0), (0, -1, 0))
    shape = simulator.solve(pin, holds=[Hold(toward((0, 0, 0), (1, 0, 0)), 'tube', 1.03 * length)])
    assert shape.converged
    assert places(shape)[0] == pytest.approx(length, rel=1e-5)
    moment = shape.wrenches[0, 5]
    assert -shape.wrenches[0, 0] == pytest.approx(force, rel=2e-4)
    assert moment**2 / (2 * stiff) == pytest.approx(force, rel=1e-3)


@pytest.mark.every(2)
@pytest.mark.parametrize(('grip', 'slip'), [('ring', 0.3), ('tube', 0.0)])
def test_shooting_on_kirchhoffs_equations_finds_the_same(grip, slip):
    simulator, holds = board(grip, slip, n_elements=128)
    shape = simulator.solve(HERE, holds=holds)
    feed = shape.state.feed
    assert shape.converged and any(feed.slides)
    jumps = [slip * np.sign(force) if slides else None
             for force, slides in zip(shape.slip_forces, feed.slides, strict=False)]
    positions, found = shot(shape, (0, 0, -0.03 * 9.81), jumps)
    away = np.linalg.norm(positions - shape.positions, axis=1).max()
    assert away < 1e-4 * 0.62
    np.testing.assert_allclose(places(shape), found, rtol=0, atol=2e-5)
    assert shape.error_estimate == pytest.approx(away, rel=0.05)


@pytest.mark.parametrize('options', [
    {}, {'load': (0.0, 0.1, 0.0), 'point_loads': [PointLoad((0, 0.3, 0.1), s=0.3)]},
    {'obstacles': [Plane((0, 0, -0.0031), (0, 0, 1))]}], ids=['weight', 'loads', 'contact'])
@pytest.mark.parametrize('rod', [CABLE, Rod(
    0.62, 0.03, lambda s: 2e-3 * (1 + s), 1.6e-3, natural_curvature=lambda s: (2 * s, 3.0),
    radius=0.003, point_masses=[(0.107, 0.01)])], ids=['even', 'tapered'])
def test_what_holds_a_place_back_is_the_slope_of_the_energy(rod, options):
    simulator = DirectSimulator(rod, n_elements=24, basis='local', **options)

    def held(one, other):
        return Hold(CLIPS[0], 'aligned', one), Hold(CLIPS[1], 'pinned', other), PLUG

    shape = simulator.solve(HERE, holds=held(0.19, 0.39))
    assert shape.converged and bool(shape.contacts) == ('obstacles' in options)
    for k, slope in enumerate(material_slope(shape)[:2]):
        energies = []
        for by in (3e-5, -3e-5):
            holds = held(0.19 + by * (k == 0), 0.39 + by * (k == 1))
            there = step(stretched(shape.state.mesh, shape.holds, holds, simulator.mesh), HERE,
                         changed(shape, holds=holds), StepInputs(holds=holds),
                         shape.element_strains)
            assert there.converged
            energies.append(there.energy)
        # (in contact, places at which it bears come and go)
        assert slope == pytest.approx((energies[0] - energies[1]) / 6e-5, abs=1e-6,
                                      rel=5e-5 if shape.contacts else 2e-6)


def test_a_ring_without_friction_changes_no_tension():
    simulator, holds = board('ring', gravity=(0, 0, 0), n_elements=256)
    shape = simulator.solve(HERE, holds=holds)
    assert shape.converged
    forces = shape.section_forces
    for s in places(shape):
        before, beyond = np.flatnonzero(np.abs(forces.s - s) < 1e-9)
        assert forces.tension[before] == pytest.approx(forces.tension[beyond], abs=2e-4)
        np.testing.assert_allclose(forces.moment[before], forces.moment[beyond], atol=1e-9)


# ---- friction, and what is remembered --------------------------------------------------------


@pytest.mark.every(2)
@pytest.mark.parametrize('grip', ['ring', 'tube'])
def test_the_gripper_pays_for_energy_and_friction(grip):
    # forth and back: nothing is lost but what friction takes, the work of the gripper is all
    simulator, holds = board(grip, 0.3)
    shape = simulator.solve(pulled(0.02), holds=holds)
    begin, work, friction = shape, 0.0, 0.0
    for by in [*np.linspace(0.021, 0.06, 40), *np.linspace(0.059, 0.04, 20)]:
        after = simulator.solve(pulled(by), shape, holds=holds)
        assert after.converged and not after.jumped
        shift = after.gripper.position - shape.gripper.position
        work += 0.5 * (shape.gripper_wrench + after.gripper_wrench)[:3] @ shift
        friction += 0.3 * np.abs(places(after) - places(shape)).sum()
        shape = after
    assert friction > 0.2 * abs(work)
    assert shape.energy - begin.energy + friction == pytest.approx(work, rel=0.03)


def test_what_slides_stays_where_it_has_come_to():
    simulator, holds = board('tube', 0.3)
    shapes = simulator.track([pulled(by) for by in (0.02, 0.04, 0.06, 0.058, 0.05, 0.02)],
                             holds=holds)
    assert all(shape.converged for shape in shapes)
    found = np.array([places(shape) for shape in shapes])
    forces = np.array([shape.slip_forces[:2] for shape in shapes])
    assert np.abs(forces).max() <= 0.3 + 1e-6
    assert found[2, 0] > found[0, 0] + 0.005         # drawn towards the gripper,
    assert found[3, 0] == found[2, 0]                # and not at once back again
    assert abs(forces[3, 0]) < 0.29
    assert np.abs(found[5] - found[0]).max() > 1e-3  # nor where it came from
    assert all(hold.s is None or hold.by.startswith('clip') for hold in shapes[-1].holds)
    assert np.isnan(shapes[-1].slip_forces[2])


def test_small_steps_and_large_ones_agree_about_where_it_slides_to():
    simulator, holds = board('tube', 0.3)
    one = simulator.solve(pulled(0.03), holds=holds)
    large = simulator.solve(pulled(0.06), one, holds=holds)
    for by in np.linspace(0.03, 0.06, 13)[1:]:
        one = simulator.solve(pulled(by), one, holds=holds)
    np.testing.assert_allclose(places(large), places(one), atol=2e-5)


def test_a_fall_is_said_where_slack_feeds_itself():
    # without friction slack gathers in one span: past some pull it leaves the others at once
    simulator, holds = board('tube', 0.0)
    shapes = simulator.track([pulled(by) for by in 0.0064 * np.arange(4, 10)],
                             initial=simulator.solve(pulled(0.0064 * 3), holds=holds), holds=holds)
    assert all(shape.converged for shape in shapes)
    assert [shape.jumped for shape in shapes].count(True) == 1
    fallen = next(k for k, shape in enumerate(shapes) if shape.jumped)
    slack = [places(shape)[0] - np.linalg.norm(shape.gripper.position - CLIPS[0].position)
             for shape in shapes]
    assert slack[fallen] > 4 * slack[fallen - 1]
    assert shapes[fallen].status == 'converged, jumped'


def test_a_dlo_that_leaves_its_ring_is_no_shape():
    simulator = DirectSimulator(CABLE, n_elements=32, basis='local')
    ring = Hold(toward((0.3, 0, 0), (1, 0, 0)), 'ring', 0.45, by='fork')
    begin = toward((0, 0, 0), (1, 0, 0))
    shape = simulator.solve(begin, holds=[ring])
    assert not shape.converged  # the bow before it weighs more than what hangs down behind
    assert 'the DLO slides out of fork at s = 0.45 m: its tip is there' in shape.status
    held = simulator.solve(begin, holds=[Hold(ring.pose, 'ring', 0.45, 0.5, by='fork')])
    assert held.converged and places(held)[0] == 0.45
    other = simulator.solve(begin, holds=[Hold(ring.pose, 'ring', 0.4, by='fork')])
    assert other.converged and places(other)[0] == pytest.approx(0.3016, abs=1e-4)


def test_what_is_out_of_reach_whatever_is_in_the_rings_is_said():
    simulator, holds = board('ring', 0.1)
    far = simulator.solve(pulled(0.4), simulator.solve(HERE, holds=holds), holds=holds)
    assert not far.converged
    assert 'out of reach' in far.status and 'from the gripper' in far.status


# ---- all around -----------------------------------------------------------------------------


@pytest.mark.sweep
def test_an_accuracy_is_kept_with_what_is_in_the_rings():
    simulator, holds = board('ring', 0.3, n_elements=None, basis=None, accuracy=1e-5)
    shape = simulator.solve(pulled(0.02), simulator.solve(HERE, holds=holds), holds=holds)
    assert shape.converged and shape.error_estimate <= 1e-5
    exact, _ = board('ring', 0.3, n_elements=512)
    there = exact.solve(pulled(0.02), exact.solve(HERE, holds=holds), holds=holds)
    assert np.linalg.norm(there.positions_at(shape.s) - shape.positions, axis=1).max() < 1e-5


def test_a_ring_takes_what_the_shape_before_has_in_it():
    simulator, holds = board('tube', 0.3)
    shape = simulator.solve(pulled(0.06), simulator.solve(HERE, holds=holds), holds=holds)
    assert shape.holds[0].s != 0.2
    again = simulator.solve(pulled(0.06), shape, holds=holds)  # which say 0.2
    np.testing.assert_allclose(places(again), places(shape), rtol=0, atol=1e-9)
    unnamed = [Hold(hold.pose, hold.grip, hold.s, hold.slip) for hold in holds[:2]] + [PLUG]
    moved = simulator.solve(HERE, holds=unnamed)
    assert moved.converged and simulator.solve(pulled(0.01), moved, holds=unnamed).converged


def test_rings_are_stored(tmp_path):
    simulator, holds = board('tube', 0.3)
    shape = simulator.solve(pulled(0.06), simulator.solve(HERE, holds=holds), holds=holds)
    shape.save(tmp_path / 'shape.npz')
    again = Shape.load(tmp_path / 'shape.npz')
    assert again.holds == shape.holds and again.holds[0].slip == 0.3
    assert np.isnan(again.slip_forces).all()
    np.testing.assert_allclose(
        places(simulator.solve(pulled(0.06), again, holds=holds)), places(shape), atol=3e-5)


@pytest.mark.parametrize(('make', 'said'), [
    (lambda: Hold(HERE, 'ring'), 'Hold.s = None: expected the place that is in the ring'),
    (lambda: Hold(HERE, 'clamped', 0.3, 0.1), 'Hold.slip = 0.1: expected 0'),
    (lambda: Hold(HERE, 'ring', 0.3, -1.0), 'Hold.slip'),
    (lambda: FarEnd(HERE, 'ring'), 'FarEnd.s = None'),
    (lambda: board()[0].solve(HERE, holds=[Hold(HERE, 'ring', 0.62)]), 'about to leave the ring'),
    (lambda: solve_many(board()[0], [HERE], holds=board()[1]), 'none that the DLO slides through'),
    (lambda: board()[0].simulate([HERE] * 3, 0.01, holds=board()[1]), 'known at rest only'),
    (lambda: DirectSimulator(Rod(0.62, 0.03, 2e-3, 1.6e-3, yield_curvature=9.0), n_elements=8)
     .solve(HERE, holds=board()[1]), 'where the rod yields'),
    (lambda: DirectSimulator(CABLE, n_elements=8, point_loads=[PointLoad(moment=(0, 0, 1e-3))])
     .solve(HERE, holds=board()[1]), 'expected forces alone'),
    (lambda: Sensitivity(board()[0].solve(HERE, holds=board()[1])), 'sticks in all its rings'),
    (lambda: board()[0].solve(HERE, holds=board()[1]).modes(), 'sticks in all its rings')])
def test_what_is_wrong_is_named(make, said):
    with pytest.raises(InvalidTask, match=said):
        make()


def test_what_sticks_answers_as_a_pin_does():
    simulator, holds = board('ring', 5.0)
    shape = simulator.solve(HERE, holds=holds)
    pinned = simulator.solve(HERE, holds=[hold.stuck for hold in holds])
    assert shape.converged and shape.stability == pinned.stability
    np.testing.assert_array_equal(shape.positions, pinned.positions)
    np.testing.assert_allclose(Sensitivity(shape).by_grips(0.3), Sensitivity(pinned).by_grips(0.3))
    assert shape.modes(2).frequencies == pytest.approx(pinned.modes(2).frequencies)


def test_the_gripper_moves_what_slides():
    # without friction every small motion lets the DLO slide: differences of shapes tell
    simulator, holds = board('ring')
    shape = simulator.solve(HERE, holds=holds)
    (answers, at_the_ring), size, s = answers_at(shape, [0.3, shape.holds[0].s]), 1e-5, 0.3
    axes, _ = shape.frame_at(s)
    poses = [HERE, *(hold.pose for hold in holds)]
    assert answers.shape == (6, 6 * len(poses))
    for column in range(6 * len(poses)):
        grip, ends = column // 6, []
        for sign in (1, -1):
            off = displaced(poses[grip], sign * size * np.eye(6)[column % 6])
            there = [posed(hold, off) if k == grip else hold for k, hold in enumerate(holds, 1)]
            ends.append(simulator.solve(HERE if grip else off, shape, holds=there))
        frames, places_there = zip(*(one.frame_at(s) for one in ends), strict=True)
        moved = (places_there[0] - places_there[1]) / (2 * size)
        turned = (frames[0] - frames[1]) @ axes.T / (2 * size)
        np.testing.assert_allclose(answers[3:, column], moved, atol=2e-3)
        np.testing.assert_allclose(answers[:3, column], [
            turned[2, 1], turned[0, 2], turned[1, 0]], atol=2e-2)
    # what is in a ring goes wherever it goes, but for what slides
    across = np.eye(3) - np.outer(*[shape.frame_at(shape.holds[0].s)[0][:, 0]] * 2)
    np.testing.assert_allclose(across @ at_the_ring[3:, 9:12], across, atol=1e-5)


def test_two_rings_with_friction_that_pull_against_each_other():
    # one would slide out, the other in: each has the sign of its own friction (a kink in between)
    simulator, holds = board('ring', 0.3)
    shapes = simulator.track([pulled(by) for by in (0.03, 0.06, 0.045, 0.06, 0.03, 0.0)],
                             holds=holds)
    assert all(shape.converged for shape in shapes)
    assert max(np.abs(shape.slip_forces[:2]).max() for shape in shapes) <= 0.3 + 1e-6


def test_on_a_mesh_that_was_refined_it_slides_on():
    # what a shape in rings keeps of how places answer was the array that is learned on
    back = (-1.0, 0.0, 0.0)
    direct = DirectSimulator(Rod(0.92, 0.03, 1.275e-4, 1e-4, radius=0.002))
    shape = direct.solve(Pose.looking_along((0, 0, 0), back), holds=[
        Hold(Pose.looking_along((-0.7435, 0, 0), back), 'tube', 0.7452),
        FarEnd(Pose.looking_along((-0.91796, 0, 0), back))])
    assert shape.converged


def test_what_is_set_down_slides_in_its_rings_without_friction_on_obstacles():
    # it rubbed between the places that were tried, and none of them was in balance
    hose = Rod.circular(0.3, 1e-3, density=1200, youngs_modulus=2e6, poisson_ratio=0.45)
    ring = Hold(Pose((0.165, 0, 0), (0, 0, 0, 1)), 'ring', 0.18)
    smooth, rough = (
        DirectSimulator(hose, obstacles=[Plane((0, 0, -0.0436), (0, 0, 1), friction=friction)],
                        n_elements=60, basis='local').solve(
            toward((0, 0, 0.006), (1, 0, -0.48)), holds=[ring]) for friction in (0.0, 0.5))
    assert smooth.converged and rough.converged
    assert rough.holds[0].s == pytest.approx(smooth.holds[0].s, abs=1e-5)
    assert rough.energy == pytest.approx(smooth.energy, rel=1e-5)
