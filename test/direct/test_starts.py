# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A Shape of another DLO, or of other surroundings, is a start and nothing more."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    FarEnd,
    InvalidTask,
    Plane,
    Pose,
    Rod,
    Shape,
    Sheet,
    Sphere,
)
from dlo_planner.direct import equilibrium, placement
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.energy.scene import build_scene, signed_distance
from dlo_planner.rods import GraspedInside

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
TILTED = Pose((0.1, 0.05, 0.9), Rotation.from_rotvec([0.2, 0.1, -0.15]).as_quat())
HERE = {'rod': Rod(1.0, 0.1, 0.5, 0.4, radius=0.002), 'gravity': (0, 0, -9.81), 'load': None,
        'obstacles': ()}
ELSEWHERE = {
    'rod': {'rod': Rod(1.0, 0.1, 0.05, 0.04, radius=0.002)}, 'gravity': {'gravity': (0, 3.0, -5.0)},
    'load': {'load': (0.0, 0.5, 0.0)}, 'obstacles': {'obstacles': [Plane((0, 0, 0.9), (0, 0, 1))]}}
MESHES = {'accuracy': {'accuracy': 1e-4}, 'accurate series': {'accuracy': 1e-3,
                                                              'basis': 'chebyshev'},
          'series': {}, 'local': {'basis': 'local'}}
YIELDING = Rod(1.0, 0.1, 0.05, 0.04, yield_curvature=3.0, radius=0.002)


def simulator(mesh='series', **other):
    made = {**HERE, **other}
    return DirectSimulator(made.pop('rod'), **made, **MESHES[mesh])


def depth(direct, shape):
    """Return how far a shape is inside the obstacles, m, looked at closely along its arcs."""
    scene, radius = build_scene(direct.obstacles, direct.rod.radius), direct.rod.radius
    normal, bend = np.empty(3), np.empty((3, 3))
    return -min(signed_distance(scene, o, np.array(shape.at(s).position), normal, bend) - radius
                for s in np.linspace(0.01, shape.s[-1], 800) for o in range(scene.kind.size))


@pytest.mark.parametrize('mesh', MESHES)
@pytest.mark.parametrize('other', ELSEWHERE)
def test_a_start_from_elsewhere_is_only_a_start(mesh, other):
    direct = simulator(mesh)
    start = simulator(mesh, **ELSEWHERE[other]).solve(LEVEL)
    for gripper in (LEVEL, TILTED):
        wanted = direct.solve(gripper)
        tolerance = 2 * wanted.error_estimate
        assert np.abs(start.positions[-1] - wanted.positions[-1]).max() > 20 * tolerance
        tracked = direct.track([gripper, gripper], initial=start)
        for found in (direct.solve(gripper, start), *tracked):
            assert found.converged and not found.jumped and found.rod is direct.rod
            assert np.abs(found.positions[-1] - wanted.positions[-1]).max() < tolerance
            assert found.energy == pytest.approx(wanted.energy, rel=1e-3)


@pytest.mark.every(3)
@pytest.mark.parametrize('mesh', ['accuracy', 'series'])
@pytest.mark.parametrize('other', ['rod', 'gravity', 'load'])
def test_a_motion_from_elsewhere_is_of_this_dlo(mesh, other):
    damped = replace(HERE['rod'], damping=(8.0, 0.0))
    direct = simulator(mesh, rod=damped)
    start = simulator(mesh, **ELSEWHERE[other]).solve(LEVEL)
    motion = direct.simulate([LEVEL] * 80, 0.03, start)
    assert motion.converged
    np.testing.assert_allclose(motion.shapes[0].at(1.0).position, start.at(1.0).position, atol=1e-9)
    np.testing.assert_allclose(motion.shapes[-1].at(1.0).position,
                               direct.solve(LEVEL).at(1.0).position, atol=2e-3)


@pytest.mark.parametrize('mesh', MESHES)
def test_a_ball_that_the_start_does_not_know(mesh):
    free = simulator(mesh).solve(LEVEL)
    ball = Sphere(free.at(0.6).position - [0, 0, 0.038], 0.05)
    direct = simulator(mesh, obstacles=[ball])
    for found in (direct.solve(LEVEL, free), direct.track([LEVEL], initial=free)[0]):
        assert found.converged and found.contacts
        assert depth(direct, found) < 1e-6
    again = DirectSimulator(HERE['rod'], obstacles=[Sphere(ball.center, ball.radius)],
                            **MESHES[mesh])  # equal, not the same: its contacts go on
    assert again.solve(LEVEL, found).iterations <= direct.solve(LEVEL, found).iterations


SHAPE = DirectSimulator(HERE['rod']).solve(LEVEL)
MIDDLE = SHAPE.at(0.6).position
HOLE = CutOut(Pose.looking_along(MIDDLE + [0, 0.03, 0], (1, 0, -0.5)), radius=0.01)
DEEP = {
    'ball': Sphere(MIDDLE, 0.05), 'below its middle': Sphere(MIDDLE + [0, 0.01, 0.02], 0.05),
    'small ball': Sphere(MIDDLE, 0.004), 'box': Box(Pose(MIDDLE, (0, 0, 0, 1)), (0.1, 0.1, 0.1)),
    'bar': Capsule(MIDDLE - [0, 0.2, 0], MIDDLE + [0, 0.2, 0], 0.02),
    'wall': Plane(MIDDLE, (-1, 0, 0.3)), 'floor': Plane(MIDDLE, (0, 0, 1)),
    'plate': Sheet(Pose(MIDDLE, (0, 0, 0, 1)), 0.3, 0.3),
    'foil': Sheet(Pose.looking_along(MIDDLE, (0.3, 0.1, 1)), 0.3, 0.3, 0.0),
    'beside the hole': Sheet.around(HOLE)}


@pytest.mark.every(5)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('name', DEEP)
def test_a_start_deep_inside_comes_out_or_says_that_it_does_not(name, basis):
    direct = DirectSimulator(HERE['rod'], basis=basis, obstacles=[DEEP[name]])
    found = direct.solve(LEVEL, SHAPE)
    assert depth(direct, SHAPE) > 1e-3
    assert not found.converged or depth(direct, found) < 2e-6
    if name in ('wall', 'floor'):
        assert found.converged
    with pytest.raises(InvalidTask, match='inside'):
        direct.simulate([LEVEL] * 3, 0.01, SHAPE)


def test_a_permanent_set_belongs_to_its_rod():
    direct = DirectSimulator(YIELDING)
    bent = direct.solve(LEVEL)
    up = Pose.looking_along((0, 0, 1), (0, 0, 1))
    assert bent.dissipated > 0
    other = DirectSimulator(replace(YIELDING, bending_stiffness=0.5), accuracy=1e-3)
    found = other.solve(up, bent)
    assert found.dissipated == 0 and np.ptp(found.positions[:, 0]) < 1e-6
    assert other.track([up], initial=bent)[0].dissipated == 0
    # the same rod in another place stays bent, whoever made it
    for again in (DirectSimulator(replace(YIELDING)), DirectSimulator(YIELDING, gravity=(0, 0, 0))):
        assert again.solve(LEVEL, bent).dissipated >= bent.dissipated
    with pytest.raises(InvalidTask, match='shape'):
        other.with_set(bent)


def test_a_simulators_own_set_outlives_a_start_from_elsewhere():
    direct = DirectSimulator(YIELDING)
    own = direct.with_set(direct.solve(LEVEL))
    up = Pose.looking_along((0, 0, 1), (0, 0, 1))
    wanted = own.solve(up)
    start = DirectSimulator(HERE['rod']).solve(LEVEL)
    assert np.ptp(wanted.positions[:, 0]) > 0.01
    np.testing.assert_allclose(own.solve(up, start).positions, wanted.positions, atol=1e-6)


def test_friction_with_other_obstacles_is_forgotten():
    rod = Rod(1.0, 0.05, 0.02, 0.015, radius=0.002)
    way = [Pose((0.3 * k / 4, 0.0, 0.2 - 0.05 * k), (0, 0, 0, 1)) for k in range(4)]
    one, other = (DirectSimulator(rod, obstacles=[Plane(point, (0, 0, 1), friction)]) for
                  point, friction in (((0, 0, 0), 0.8), ((5.0, 0, 0), 0.8)))
    dragged = one.track(way)[-1]
    stuck = np.linalg.norm([contact.friction for contact in dragged.contacts], axis=1).max()
    assert stuck > 1e-3
    clean = replace(dragged, state=dragged.state.forgotten())
    same = DirectSimulator(rod, obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.8)])
    np.testing.assert_array_equal(same.solve(way[-1], dragged).positions,
                                  one.solve(way[-1], dragged).positions)
    np.testing.assert_array_equal(other.solve(way[-1], dragged).positions,
                                  other.solve(way[-1], clean).positions)


def starts(direct, folder):
    """Return shapes that know less than one that comes straight from a simulator."""
    shape = direct.solve(LEVEL)
    shape.save(folder / 'shape.npz')
    return {'loaded': Shape.load(folder / 'shape.npz'), 'coarser': shape.resample(7),
            'finer': shape.resample(300), 'moved': shape.moved((0.3, 0.1, 0.0)),
            'predicted': Sensitivity(shape).moved(1e-3 * np.ones(6))}


@pytest.mark.parametrize('mesh', MESHES)
def test_what_knows_less_is_a_start_all_the_same(mesh, tmp_path):
    direct = simulator(mesh, obstacles=[Plane((0, 0, 0.4), (0, 0, 1), 0.3)])
    wanted = direct.solve(TILTED)
    for start in starts(direct, tmp_path).values():
        for found in (direct.solve(TILTED, start), direct.track([TILTED], initial=start)[0]):
            assert found.converged and not found.jumped
            np.testing.assert_allclose(found.at(1.0).position, wanted.at(1.0).position,
                                       atol=2 * wanted.error_estimate + 1e-8)
        motion = direct.simulate([start.gripper] * 3, 0.01, start)
        assert motion.converged
        assert motion.velocities.shape == (3, len(motion.shapes[0].positions), 3)
        assert np.abs(motion.velocities).max() < 0.2


def test_what_is_no_start_is_refused_by_name():
    direct = simulator()
    held = direct.solve(LEVEL, far_end=FarEnd(Pose((0.9, 0, 1), (0, 0, 0, 1))))
    grasped = GraspedInside(HERE['rod'], 0.4).solve(LEVEL)
    for one in (direct.solve, lambda gripper, start: direct.track([gripper], initial=start),
                lambda gripper, start: direct.simulate([gripper] * 2, 0.01, start)):
        with pytest.raises(InvalidTask, match='initial.*grasped inside'):
            one(LEVEL, grasped)
    with pytest.raises(InvalidTask, match='initial is held at its far end'):
        direct.simulate([LEVEL] * 2, 0.01, held)
    with pytest.raises(InvalidTask, match=r'grippers\[0\]'):
        direct.simulate([TILTED] * 2, 0.01, SHAPE)
    dfp = DirectSimulator(HERE['rod'], method='dfp')
    with pytest.raises(InvalidTask, match='method'):
        dfp.simulate([LEVEL] * 2, 0.01, held, far_ends=[held.far_end] * 2)
    paper = DirectSimulator(HERE['rod'], method='dfp', strains='paper')
    with pytest.raises(InvalidTask, match='strains'):
        paper.simulate([LEVEL] * 2, 0.01)
    assert direct.solve(LEVEL, held).far_end is None
    np.testing.assert_allclose(direct.solve(LEVEL, held).positions, SHAPE.positions, atol=1e-8)


def test_a_motion_without_a_first_shape_ends_there():
    blocked = simulator(obstacles=[Plane((0, 0, 1.2), (0, 0, 1))])
    motion = blocked.simulate([LEVEL] * 5, 0.01)
    assert len(motion) == 1 and not motion.converged


def test_a_shape_is_carried_only_where_nothing_holds_it_back():
    direct, shift = simulator(), np.array([0.1, -0.3, 0.2])
    moved, there = direct.solve(LEVEL).moved(shift), Pose(LEVEL.position + shift, LEVEL.quaternion)
    np.testing.assert_allclose(moved.positions, direct.solve(there).positions, atol=1e-9)
    lying = simulator(obstacles=ELSEWHERE['obstacles']['obstacles']).solve(LEVEL)
    held = direct.solve(LEVEL, far_end=FarEnd(Pose((0.8, 0, 1), (0, 0, 0, 1)), 'pinned'))
    assert lying.contacts
    for shape in (lying, held):
        with pytest.raises(InvalidTask, match='touches nothing and whose far end is free'):
            shape.moved(shift)


@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_what_is_set_down_on_a_sphere_slides_off_and_comes_to_rest(friction):
    hose = Rod(2.0, 0.18, 0.25, 0.2, radius=0.01)
    below = [Plane((0, 0, -0.755), (0, 0, 1), friction=friction),
             Sphere((0.869, 0, -0.243), 0.12, friction=friction)]
    direct = DirectSimulator(hose, obstacles=below, basis='local', n_elements=48)
    shape = direct.solve(Pose((0, 0, 0.04), (0, 0.0469, 0, 0.9989)))
    assert shape.converged and len(shape.contacts) > 2
    # there was no way along which it could have rubbed
    assert all(not contact.friction.any() for contact in shape.contacts)


SOFT = Rod.circular(0.3, 0.001, density=1200, youngs_modulus=2e6, poisson_ratio=0.45)
OVER_A_BAR = [Plane((0, 0, -0.025), (0, 0, 1), friction=0.5),
              Capsule((0.217, -0.3, -0.014), (0.217, 0.3, -0.014), 0.009, friction=0.5)]


def test_a_held_one_grows_among_obstacles_once_whatever_the_mesh(monkeypatch):
    grown, grow = [], placement._grow_thickness
    monkeypatch.setattr(placement, '_grow_thickness',
                        lambda *given: grown.append(given[0].s.size) or grow(*given))
    shape = DirectSimulator(SOFT, obstacles=OVER_A_BAR, accuracy=1e-4).solve(
        Pose((0, 0, 0.006), (0, -0.09, 0, 0.996)),
        far_end=FarEnd(Pose((0.285, 0, 0.006), (0, 0, 0, 1)), 'aligned'))
    assert shape.converged and shape.error_estimate < 1e-4
    assert shape.s.size > grown[0] and len(grown) == 1


def test_an_accuracy_among_obstacles_is_looked_at_once_a_mesh(monkeypatch):
    looked, halve = [], equilibrium.halved
    monkeypatch.setattr(equilibrium, 'halved',
                        lambda *given: looked.append(given[0].s.size) or halve(*given))
    shape = DirectSimulator(SOFT, obstacles=OVER_A_BAR, accuracy=1e-5).solve(
        Pose((0, 0, 0.006), (0, 0, 0, 1)))
    assert shape.converged and shape.contacts and shape.error_estimate < 1e-5
    assert looked and len(looked) == len(set(looked))
