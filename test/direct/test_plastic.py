# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plastic bending and torsion: textbook curves, springback, energy, direction, mesh."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Capsule, DirectSimulator, FarEnd, Plane, PointLoad, Pose, Rod, Shape
from dlo_planner.direct import equilibrium, statics
from dlo_planner.direct.energy_balance import overspent
from dlo_planner.energy.plastic import closest_point_projection
from dlo_planner.geometry.kinematics import folded

HERE = Pose.identity()
BENDING, TORSION = 1.3, 0.7


def on_a_circle(curvature, axis=(0, 1, 0)):
    """Return where the far end of a rod of length 1 is that is bent to a circle about `axis`."""
    turn = Rotation.from_rotvec(curvature * np.asarray(axis, dtype=float))
    s = np.linspace(0, 1, 4001)
    middle = 0.5 * (s[1:] + s[:-1])
    along = Rotation.from_rotvec(np.outer(middle * curvature, axis)).apply([1.0, 0, 0])
    return Pose.from_rotation(along.mean(axis=0), turn.as_matrix())


def bent(rod, curvatures, axis=(0, 1, 0), elements=8):
    simulator = DirectSimulator(rod, basis='local', n_elements=elements, gravity=(0, 0, 0))
    ends = [on_a_circle(k, axis) for k in curvatures]
    return simulator, simulator.track([HERE] * len(ends), far_ends=ends)


def section(model, **more):
    return Rod(1.0, 0.0, BENDING, TORSION, yield_curvature=0.8, yield_torsion=0.6,
               section_model=model, **more)


def round_moment(x):
    """Return M / M_y of a solid round section, from the integral over its fibers."""
    y = (np.arange(200_000) + 0.5) / 200_000
    weight = y * np.sqrt(1 - y**2)
    return np.sum(weight * np.minimum(x * y, 1)) / np.sum(weight * y)


@pytest.mark.parametrize(('model', 'moment'), [
    ('ideal', lambda x: 1.0), ('rectangular', lambda x: 1.5 - 0.5 / x**2),
    ('round', round_moment)])
def test_moment_over_curvature(model, moment):
    ratios = np.array([0.5, 1.0, 1.2, 1.7, 2.5, 4.0])
    _, shapes = bent(section(model, hardening=0.0), 0.8 * ratios)
    for ratio, shape in zip(ratios, shapes, strict=True):
        wanted = ratio if ratio <= 1 else moment(ratio)
        got = np.linalg.norm(shape.gripper_wrench[3:]) / (BENDING * 0.8)
        assert got == pytest.approx(wanted, rel=1.5e-3)


@pytest.mark.parametrize('model', ['rectangular', 'round'])
def test_springback_is_moment_over_stiffness(model):
    simulator, shapes = bent(section(model), [0.8, 1.6, 2.4])
    moment = np.linalg.norm(shapes[-1].gripper_wrench[3:])
    free = simulator.solve(HERE, shapes[-1])
    assert free.converged
    np.testing.assert_allclose(np.linalg.norm(free.element_strains, axis=1), 2.4 - moment / BENDING,
                               rtol=1e-4)


def test_torsion_of_a_round_section():
    # elastic core: T / T_y = 4/3 - (T_y's twist / twist)^3 / 3
    rod = section('round')
    simulator = DirectSimulator(rod, basis='local', n_elements=8, gravity=(0, 0, 0))
    for ratio in (0.7, 1.5, 3.0):
        end = Pose((1.0, 0, 0), Rotation.from_rotvec([0.6 * ratio, 0, 0]).as_quat())
        shape = simulator.solve(HERE, far_end=end)
        wanted = ratio if ratio <= 1 else 4 / 3 - 1 / (3 * ratio**3)
        assert abs(shape.gripper_wrench[3]) == pytest.approx(TORSION * 0.6 * wanted, rel=2e-3)


@pytest.mark.parametrize('model', ['ideal', 'rectangular', 'round'])
def test_energy_lost_is_the_work_done_less_what_is_stored(model):
    # a full cycle of bending to and fro: the loop's area, never negative on the way
    way = 2.0 * np.sin(np.linspace(0, 2.5 * np.pi, 81))[1:]
    simulator, shapes = bent(section(model, hardening=0.02), way)
    lost = np.array([shape.dissipated for shape in shapes])
    assert (np.diff(lost) >= -1e-15).all()
    assert lost[-1] > 0
    moment = np.array([-shape.gripper_wrench[4] for shape in shapes])
    work = np.sum(0.5 * (moment[1:] + moment[:-1]) * np.diff(way))
    stored = np.array([shape.energy for shape in shapes])
    assert work == pytest.approx(lost[-1] - lost[0] + stored[-1] - stored[0], rel=5e-3)
    del simulator


@pytest.mark.parametrize(('model', 'within'), [('ideal', 1e-4), ('round', 4e-3)])
def test_yielding_of_what_is_round_knows_no_preferred_direction(model, within):
    rod = section(model, hardening=0.05)
    one = bent(rod, [0.8, 2.0])[1][-1]
    for angle in (0.3, 1.1, 2.5):
        axis = (0, np.cos(angle), np.sin(angle))
        other = bent(rod, [0.8, 2.0], axis)[1][-1]
        np.testing.assert_allclose(other.gripper_wrench[3:], -np.linalg.norm(
            one.gripper_wrench[3:]) * np.array(axis), atol=within * BENDING * 0.8)
        assert other.dissipated == pytest.approx(one.dissipated, rel=within)


@pytest.mark.parametrize('roll', [0, 1])
@pytest.mark.parametrize('model', ['rectangular', 'round', 'ideal'])
def test_what_is_bent_in_a_plane_of_symmetry_stays_in_it(model, roll):
    # it falls to no side by rounding: mirror images of fibers cancel
    stiffness = (0.4, BENDING) if roll == 0 else (BENDING, 0.4)
    rod = replace(section(model, hardening=0.1), bending_stiffness=stiffness, tip_mass=0.1)
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    if roll:
        axes = axes[:, [0, 2, 1]] * (1, -1, 1)
    tilted = Rotation.from_rotvec([0, 0.7, 0]).as_matrix()
    grippers = [Pose.from_rotation((0, 0, 0), turn @ axes) for turn in (np.eye(3), tilted)]
    for shape in DirectSimulator(rod, n_elements=24).track(grippers):
        assert shape.converged and shape.dissipated > 0
        np.testing.assert_allclose(shape.positions[:, 1], 0, atol=1e-13)


def fine_disc(count=200):
    """Return heights (n, 2) over both axes and weights of the cells of a disc; M_y is 1."""
    middle = (np.arange(count) + 0.5) / count * 2 - 1
    cells = np.column_stack([axis.ravel() for axis in np.meshgrid(middle, middle)])
    cells = cells[np.hypot(*cells.T) < 1]
    return cells, np.full(len(cells), 1 / np.sum(cells[:, 0] ** 2))


@pytest.mark.parametrize('more', [{'section_model': 'round'}, {}], ids=['stated', 'default'])
def test_a_cantilever_rolled_under_its_load_follows_its_fibers(more):
    # a short rod with a heavy tip turns about its axis: statics tells the moments, fibers the rest
    known = Rod.circular(0.05, 2e-3, 0.0, 110e9, 0.34, yield_stress=60e6, hardening=0.1)
    rod = replace(known, **more, tip_mass=1.8 * known.bending_stiffness[0]
                  * known.yield_curvature[0] / (0.05 * 9.81), section=known.section)
    if more:
        rod = replace(rod, section=None)
    direct = DirectSimulator(rod, basis='local', n_elements=6)
    ways = np.linspace(0, 1.5 * np.pi, 13)
    shapes = direct.track([Pose((0, 0, 0), Rotation.from_rotvec([a, 0, 0]).as_quat())
                           for a in ways])
    heights, weights = fine_disc()
    plastic = np.zeros((6, len(weights)))
    largest, hardening = 0.0, 0.1
    for shape in shapes:
        assert shape.converged
        middle = 0.5 * (shape.positions[1:] + shape.positions[:-1])
        force = np.array([0, 0, -9.81 * rod.tip_mass])
        for e in range(6):
            frame = 0.5 * (shape.frames[e] + shape.frames[e + 1])
            statics = (frame.T @ np.cross(shape.positions[-1] - middle[e], force))[1:]
            bend = shape.element_strains[e, 1:] / rod.yield_curvature
            strain = heights @ bend
            elastic = np.clip(strain - plastic[e], -1, 1)
            plastic[e] = strain - elastic
            moment = (1 - hardening) * heights.T @ (weights * elastic) + hardening * bend
            off = moment - statics / (rod.bending_stiffness * np.array(rod.yield_curvature))
            largest = max(largest, np.linalg.norm(off))
    assert shapes[-1].dissipated > 2 * shapes[1].dissipated > 0
    assert largest < 0.02


def test_projection_onto_an_ellipse_is_the_nearest_point(rng):
    for _ in range(200):
        k1, k2, l1, l2 = rng.uniform(0.1, 5, 4)
        d1, d2 = rng.normal(size=2) * 5
        e1, e2, multiplier = closest_point_projection(d1, d2, k1, k2, l1, l2)
        if multiplier == 0:
            assert (e1, e2) == (d1, d2)
            continue
        assert np.hypot(e1 / l1, e2 / l2) == pytest.approx(1, abs=1e-12)
        angles = np.linspace(0, 2 * np.pi, 20_001)
        away = k1 * (d1 - l1 * np.cos(angles)) ** 2 + k2 * (d2 - l2 * np.sin(angles)) ** 2
        mine = k1 * (d1 - e1) ** 2 + k2 * (d2 - e2) ** 2
        assert mine <= away.min() + 1e-12


def test_plastic_set_is_carried_and_can_be_forgotten():
    rod = Rod.circular(0.6, 2e-3, 8960.0, 110e9, 0.34, yield_stress=60e6, tip_mass=0.05,
                       section_model='round', hardening=0.01)
    simulator = DirectSimulator(rod)
    level = Pose((0, 0, 1), (0, 0, 0, 1))
    up = Pose((0, 0, 1), Rotation.from_euler('y', -90, degrees=True).as_quat())
    loaded = simulator.solve(level)
    assert loaded.dissipated > 0
    stood, virgin = simulator.solve(up, loaded), simulator.solve(up)
    assert np.hypot(*stood.positions[-1, :2]) > 0.02  # stays bent where a new one stands straight
    assert np.hypot(*virgin.positions[-1, :2]) < 1e-6
    later = simulator.with_set(loaded)
    np.testing.assert_allclose(later.solve(up).positions, stood.positions, atol=1e-5)
    np.testing.assert_allclose(later.reset().solve(up).positions, virgin.positions, atol=1e-12)
    assert loaded.bent[0, 1] != pytest.approx(loaded.element_strains[0, 1])


def test_a_plastic_hinge_is_no_answer_on_any_mesh_and_hardening_cures_it():
    level = Pose((0, 0, 1), (0, 0, 0, 1))
    heavy = {'length': 1.0, 'mass_per_length': 0.0, 'bending_stiffness': 1.0,
             'torsional_stiffness': 0.7, 'tip_mass': 0.02, 'yield_curvature': 0.12}
    soft, firm = Rod(**heavy), Rod(**heavy, hardening=0.05)
    tips = {rod: [DirectSimulator(rod, basis='local', n_elements=n).solve(level)
                  for n in (32, 64)] for rod in (soft, firm)}
    hinge, spread = tips[soft], tips[firm]
    assert all(shape.converged for shape in spread)
    apart = np.linalg.norm(hinge[0].positions[-1] - hinge[1].positions[-1])
    assert apart > 5e-3
    assert not any(shape.converged for shape in hinge)
    assert all(shape.error_estimate == np.inf for shape in hinge)
    assert np.linalg.norm(spread[0].positions[-1] - spread[1].positions[-1]) < 5e-4


def test_motion_with_plasticity_loses_energy(wire):
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, yield_stress=60e6, hardening=0.05,
                       damping=0.01)
    level = Pose((0, 0, 1), (0, 0, 0, 1))
    straight = DirectSimulator(wire, gravity=(0, 0, 0)).solve(level)
    motion = DirectSimulator(rod).simulate([level] * 60, 0.01, straight)
    lost = [shape.dissipated for shape in motion.shapes]
    assert motion.converged and lost[-1] > 1e-3
    assert (np.diff(lost) >= 0).all()
    total = motion.energy + lost
    assert (np.diff(total) <= 1e-6 * abs(motion.energy[0])).all()  # the rest is the damping's


def test_thresholds_from_yield_stress():
    wire = Rod.circular(1.0, 2e-3, 8960.0, 100e9, 0.25, yield_stress=50e6)
    assert wire.yield_curvature == pytest.approx((0.5, 0.5))  # strain 5e-4 at 1 mm
    assert wire.yield_torsion == pytest.approx(50e6 / np.sqrt(3) / 40e9 / 1e-3)
    spring = Rod.rectangular(1.0, 10e-3, 1e-3, 7800.0, 200e9, 0.25, yield_stress=1e9)
    assert spring.yield_curvature == pytest.approx((10.0, 1.0))


@pytest.mark.parametrize('model', ['ideal', 'rectangular', 'round'])
def test_what_is_let_go_has_no_strain_since_its_stress_free_shape(model):
    # bent about both axes and twisted a little beyond the limits: each of it springs back by itself
    known = {'length': 1.0, 'mass_per_length': 0.0, 'bending_stiffness': (BENDING, 0.4),
             'torsional_stiffness': TORSION}
    rod = Rod(**known, natural_curvature=(0.2, -0.3), natural_twist=0.4, section_model=model,
              yield_curvature=(0.8, 0.5), yield_torsion=0.6, hardening=0.1)
    there = Rod(**known, natural_curvature=(1.1, -0.8), natural_twist=1.4)
    options = {'basis': 'local', 'n_elements': 8, 'gravity': (0, 0, 0)}
    end = DirectSimulator(there, **options).solve(HERE).at(1.0)
    simulator = DirectSimulator(rod, **options)
    held = simulator.solve(HERE, far_end=end)
    assert held.converged and held.dissipated > 0
    free = simulator.solve(HERE, held)
    assert free.converged and free.dissipated == pytest.approx(held.dissipated)
    np.testing.assert_allclose(free.bent, 0, atol=1e-9)
    left = np.abs(free.element_strains - [0.4, 0.2, -0.3])
    assert (left.max(axis=0) > 0.02).all()  # all three are set


@pytest.mark.parametrize(('axis', 'moment'), [((0, 1, 0), BENDING * 0.8), ((0, 0, 1), 0.4 * 0.5)])
def test_each_axis_has_its_own_limit(axis, moment):
    rod = Rod(1.0, 0.0, (BENDING, 0.4), TORSION, yield_curvature=(0.8, 0.5), yield_torsion=0.6)
    shapes = bent(rod, [0.4, 0.78, 2.0], axis)[1]
    assert (shapes[1].dissipated == 0) == (moment == BENDING * 0.8)
    assert np.linalg.norm(shapes[-1].gripper_wrench[3:]) == pytest.approx(moment, rel=1e-5)


def test_a_set_stays_when_obstacles_go():
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, yield_stress=60e6, hardening=0.1)
    floor = Plane((0, 0, -5.0), (0, 0, 1))
    direct = DirectSimulator(rod, n_elements=24, obstacles=[floor])
    used = direct.with_set(direct.solve(HERE))
    down = Pose.looking_along((0, 0, 0), (0, 0, -1))
    hanging = used.solve(down)
    assert np.hypot(*hanging.positions[-1, :2]) > 0.05
    np.testing.assert_allclose(used.without_obstacles().solve(down).positions, hanging.positions,
                               atol=1e-8)
    new = used.with_rod(rod).solve(down)
    assert np.hypot(*new.positions[-1, :2]) < 1e-6


@pytest.mark.parametrize(('model', 'ratio'), [('rectangular', 1 / np.sqrt(0.4)), ('ideal', None)])
def test_a_dead_moment_bends_by_the_curve_of_each_part(model, ratio):
    # 1.3 times the yield moment of the first half; the other one is three times as stiff and bent
    hardening = 0.0 if ratio else 0.1
    rod = section(model, hardening=hardening)
    rod = replace(rod, bending_stiffness=((0, 1.0), (0.5, 1.0), (0.5, 3.0), (1.0, 3.0)),
                  natural_curvature=lambda s: (0.0 if s < 0.5 else -0.4, 0.0))
    moment = 1.3 * 0.8
    simulator = DirectSimulator(rod, basis='local', n_elements=16, gravity=(0, 0, 0),
                                point_loads=[PointLoad(moment=(0, moment, 0))])
    shape = simulator.solve(HERE)
    assert shape.converged and shape.dissipated > 0
    first = 0.8 * (ratio or 1 + 0.3 / hardening)
    middle = 0.5 * (shape.s[1:] + shape.s[:-1])
    wanted = np.where(middle < 0.5, first, moment / 3 - 0.4)
    np.testing.assert_allclose(shape.element_strains[:, 1], wanted, rtol=2e-3)
    np.testing.assert_allclose(shape.element_strains[:, [0, 2]], 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(shape.gripper_wrench[4]), moment, rtol=1e-8)
    free = DirectSimulator(rod, basis='local', n_elements=16, gravity=(0, 0, 0))
    back = free.solve(HERE, shape)  # a set belongs to the rod, whatever acts on it
    np.testing.assert_allclose(back.element_strains[:, 1],
                               np.where(middle < 0.5, first - moment, -0.4), rtol=3e-3)


def test_a_set_keeps_its_turn_on_another_mesh():
    rod = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, yield_curvature=0.2, hardening=0.1)
    shape = DirectSimulator(rod, basis='local', n_elements=32).solve(Pose.identity())
    past = shape.history
    turn = np.diff(past.s) @ past.plastic
    assert abs(turn).max() > 0.01
    for elements in (64, 47):
        finer = DirectSimulator(rod, basis='local', n_elements=elements).mesh
        again = finer.past(past).plastic
        np.testing.assert_allclose(np.diff(finer.s) @ again, turn, rtol=0, atol=1e-12)


def loaded_wire(ratio, **more):
    """Return a simulator of a level wire whose load bends it to `ratio` yield moments."""
    wire = Rod.circular(1.0, 2e-3, 8960.0, 120e9, 0.34, yield_stress=100e6, **more)
    limit = np.max(wire.yield_curvature) * wire.bending_stiffness[0]
    weight = 9.81 * wire.mass_per_length
    return wire, {'load': (0, 0, weight - 2 * ratio * limit)}


def test_a_moment_beyond_the_limit_is_a_hinge_not_an_answer():
    for ratio, bears in ((1.3, True), (1.65, True), (1.9, False), (2.5, False)):
        wire, load = loaded_wire(ratio)
        shape = DirectSimulator(wire, **load).solve(HERE)
        assert shape.converged == bears and (shape.hinge is None) == bears
        if not bears:
            assert 'plastic hinge at s = 0.0' in shape.status and not shape.nearly
        firm, load = loaded_wire(ratio, hardening=0.02)
        assert DirectSimulator(firm, **load).solve(HERE).converged


def test_a_hinge_is_told_on_given_elements():
    for basis, elements in (('local', 16), ('local', 64), ('local', 400), ('chebyshev', 64)):
        for ratio, bears in ((1.3, True), (1.65, True), (1.9, False), (2.5, False)):
            wire, load = loaded_wire(ratio)
            shape = DirectSimulator(wire, basis=basis, n_elements=elements, **load).solve(HERE)
            assert shape.converged == bears == (shape.hinge is None)
            assert ('plastic hinge' in shape.status) != bears
            assert np.isfinite(shape.error_estimate) == bears


def test_what_follows_a_hinge_is_no_answer_either(tmp_path):
    wire, load = loaded_wire(2.5)
    loaded = DirectSimulator(wire, basis='local', n_elements=16, **load).solve(HERE)
    bare = DirectSimulator(wire, basis='local', n_elements=16)
    free = bare.solve(HERE, loaded)
    assert free.hinge == loaded.hinge and not free.converged and free.error_estimate == np.inf
    loaded.save(tmp_path / 'hinge.npz')
    kept = Shape.load(tmp_path / 'hinge.npz')
    assert kept.hinge == loaded.hinge and not bare.solve(HERE, kept).converged


def bent_round_a_mandrel(elements, parts):
    """Return a simulator of a wire beside a mandrel, and it bent round by a pull at its end."""
    clamp, radius, thin = Pose((0, 0, 0), (0, 0, 0, 1)), 0.03, 0.001
    wire = Rod.circular(0.2, 2 * thin, 7850, 2e11, 0.3, yield_stress=300e6)
    beside, around = 0.02, radius + thin
    mandrel = Capsule((beside, -0.05, -around), (beside, 0.05, -around), radius)
    simulator = DirectSimulator(wire, gravity=(0, 0, 0), basis='local', n_elements=elements,
                                obstacles=[mandrel])
    ends = []
    for angle in np.pi / 2 * np.arange(1, parts + 1) / parts:
        along, up = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([
            np.sin(angle), 0, np.cos(angle) - 1])
        place = (beside, 0, 0) + around * up + (0.18 - angle * around - 2e-4) * along
        ends.append(FarEnd(Pose(place, (0, 0, 0, 1)), 'pinned'))
    return simulator, clamp, simulator.track([clamp] * parts, far_ends=ends)[-1]


@pytest.mark.every(3)
@pytest.mark.parametrize('elements, parts', [(64, 15), (48, 15), (64, 16)])
def test_a_wire_let_go_beside_its_mandrel_springs_back(elements, parts):
    simulator, clamp, held = bent_round_a_mandrel(elements, parts)
    free = simulator.solve(clamp, held)
    assert held.converged and free.converged and free.dissipated == held.dissipated
    assert free.energy < held.energy
    limit = simulator.rod.yield_curvature[0]
    change = np.linalg.norm(free.element_strains - held.element_strains, axis=1)
    assert change.max() < 2 * limit  # it unloads elastically: the moment turns over at most


def test_no_shape_takes_more_energy_than_it_was_given():
    wire, load = loaded_wire(1.65)
    simulator = DirectSimulator(wire, basis='local', n_elements=32, **load)
    shape = simulator.solve(HERE)
    there = simulator.solve(Pose((0, 0, 1e-3), HERE.quaternion), shape)
    assert there.converged and overspent(shape, there) == 0
    much = replace(there, dissipated=there.dissipated + 10.0)
    assert overspent(shape, much) == pytest.approx(10.0, rel=0.1)
    its_set = replace(there.history, plastic=3 * there.history.plastic)
    wrong = replace(there, converged=False, state=replace(
        there.state, overspent=10.0, history=its_set))
    assert 'lost 10 J more to plastic deformation than it was given' in wrong.status
    assert not wrong.nearly
    next_one = simulator.solve(HERE, wrong)  # begins with the set before it
    assert next_one.converged
    np.testing.assert_allclose(next_one.positions[-1], shape.positions[-1], atol=1e-4)
    np.testing.assert_allclose(next_one.history.plastic, shape.history.plastic, atol=1e-3)


def test_energies_of_other_forces_or_another_rod_refuse_no_shape():
    # a wire that begins high up, as it hung under gravity upward or was softer, ends where it does
    # from nowhere; it "loses" what the other forces or the other rod had no part in
    wire, soft = (Rod.circular(0.6, 0.002, 8900, modulus, 0.34, yield_stress=70e6, hardening=0.05)
                  for modulus in (1.2e11, 1.2e10))
    down, up, other = (DirectSimulator(rod, gravity=(0, 0, g), basis='local', n_elements=32)
                       for rod, g in ((wire, -60.0), (wire, 60.0), (soft, -60.0)))
    cold = down.solve(HERE)
    for start in (up.solve(HERE), other.solve(HERE)):
        shape = down.solve(HERE, start)
        assert start.converged and shape.converged
        assert overspent(start, shape) == 0
    np.testing.assert_allclose(shape.positions, cold.positions, atol=1e-6)


def test_a_step_that_takes_more_is_refused_and_leaves_the_set_before_it(monkeypatch):
    wire, load = loaded_wire(1.3)
    more = DirectSimulator(wire, basis='local', n_elements=32, **loaded_wire(1.65)[1])
    shape = DirectSimulator(wire, basis='local', n_elements=32, **load).solve(HERE)
    monkeypatch.setattr(statics, 'overspent', lambda *_: 10.0)
    wrong = more.solve(HERE, shape)
    assert shape.converged and not wrong.converged and 'lost 10 J more' in wrong.status
    np.testing.assert_array_equal(wrong.history.plastic, shape.history.plastic)
    monkeypatch.undo()
    assert more.solve(HERE, shape).converged


def test_what_no_dlo_can_be_in_leaves_the_set_before_it(monkeypatch):
    wire, load = loaded_wire(1.3)
    simulator = DirectSimulator(wire, basis='local', n_elements=8, **load)
    assert simulator.solve(HERE).history.plastic.any()
    monkeypatch.setattr(equilibrium, 'is_equilibrium', lambda *_: False)
    monkeypatch.setattr(Shape, 'impossible', 'an element is bent by more than half a turn')
    wrong = simulator.solve(HERE)
    assert not wrong.converged and not wrong.history.plastic.any()


def test_an_element_bent_by_more_than_half_a_turn_is_no_answer():
    lengths, natural = np.array([0.1, 0.2]), np.zeros((2, 3))
    for bend, twist, is_folded in ((0.99, 0, False), (1.01, 0, True), (0, 9, False),
                                   (np.nan, 0, True)):
        strains = np.array([[twist * np.pi / 0.1, 0, 0], [0, 0.6 * bend * np.pi / 0.2,
                                                          0.8 * bend * np.pi / 0.2]])
        assert folded(lengths, strains, natural) == is_folded
        assert not folded(lengths, strains, strains.copy()) or np.isnan(bend)


@pytest.fixture(scope='module')
def known():
    """Return rods that yield, the poses of their gripper, and shapes of 640 elements there."""
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, hardening=0.05, yield_stress=40e6)
    spring = Rod.rectangular(0.8, 10e-3, 1e-3, 7800.0, 200e9, 0.25, hardening=0.1,
                             yield_stress=60e6)
    poses = [Pose((0, 0, 0), Rotation.from_euler('yz', [turn, 0.3 * turn]).as_quat())
             for turn in (0.3, 0.0, -0.5, -1.0, -0.5, 0.0, 0.3, 0.8)]
    return [(rod, poses, DirectSimulator(rod, basis='local', n_elements=640).track(poses))
            for rod in (wire, spring)]


def errors_on_the_way(rod, poses, exact, **how):
    """Return errors of the tip and estimates, (n,) m, beside exact shapes; all steps converge."""
    shapes = DirectSimulator(rod, **how).track(poses)
    assert all(shape.converged for shape in [*shapes, *exact]) and shapes[-1].dissipated > 0
    away = [np.linalg.norm(one.positions[-1] - other.positions[-1])
            for one, other in zip(shapes, exact, strict=True)]
    return np.array(away), np.array([shape.error_estimate for shape in shapes])


@pytest.mark.parametrize('how', [{}, {'accuracy': 1e-3}, {'accuracy': 1e-4},
                                 {'basis': 'local', 'n_elements': 64}])
def test_the_error_of_a_set_is_known_where_it_yields_no_more(known, how):
    for rod, poses, exact in known:
        error, estimate = errors_on_the_way(rod, poses, exact, **how)
        assert (error < 1.6 * estimate).all()
        assert np.median(error / estimate) > 0.1
        assert error.max() < how.get('accuracy', 1e-3)


def test_the_error_of_a_set_goes_with_it(tmp_path):
    rod = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, hardening=0.05, yield_stress=40e6)
    up = Pose((0, 0, 1), Rotation.from_euler('y', -90, degrees=True).as_quat())
    coarse = DirectSimulator(rod, basis='local', n_elements=16)
    loaded = coarse.solve(HERE)
    loaded.save(tmp_path / 'set.npz')
    for start in (loaded, type(loaded).load(tmp_path / 'set.npz')):
        for simulator in (coarse, DirectSimulator(rod, basis='local', n_elements=32)):
            assert simulator.solve(up, start).error_estimate >= loaded.error_estimate
        assert not DirectSimulator(rod, accuracy=1e-5).solve(up, start).converged


def test_a_set_stays_on_its_mesh_though_a_finer_one_is_wanted():
    spring = Rod.rectangular(0.8, 10e-3, 1e-3, 7800.0, 200e9, 0.25, hardening=0.02,
                             yield_stress=60e6)
    poses = [Pose((0, 0, 0), Rotation.from_euler('y', turn).as_quat())
             for turn in (1.2, 0.9, 0.0, -1.2)]
    shapes = DirectSimulator(spring, accuracy=2e-5).track(poses)
    first = next(shape for shape in shapes if shape.dissipated > 0)
    later = shapes[shapes.index(first):]
    assert later[-1].dissipated > 2 * first.dissipated
    assert all(np.array_equal(shape.s, first.s) for shape in later)
    assert not later[-1].converged and later[-1].error_estimate > 2e-5


def test_what_comes_after_a_motion_knows_the_error_of_the_set_before_it():
    rod = Rod(1.0, 0.1, 0.05, 0.04, yield_curvature=1.0, hardening=0.1, damping=(1.0, 0.01))
    direct = DirectSimulator(rod, basis='local', n_elements=8)
    start = direct.solve(HERE)
    motion = direct.simulate([HERE] * 3, 0.01, start)
    assert motion.converged and start.history.set_error > 0
    assert motion.shapes[-1].history.set_error == start.history.set_error
    assert direct.solve(HERE, motion.shapes[-1]).error_estimate >= start.history.set_error
