# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import numpy as np
import pytest
from references.blocks import dense
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, CutOut, FarEnd, Plane, PointLoad, Pose, Rod, Sheet, Sphere
from dlo_planner.direct.discretization import Discretization
from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.loads import node_forces, node_masses, node_moments
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import new_configuration
from dlo_planner.energy.scene import EDGE, FACE, NODE_FACE
from dlo_planner.minimize.hessian import assemble, new_hessian
from dlo_planner.model.section import Section
from dlo_planner.model.supports import Surroundings

GRAVITY = np.array([1.0, -2.0, -9.0])
BASE = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()


def at(system, q):
    state = new_configuration(system)
    state.q[:] = q
    energy, _ = evaluate(system, state)
    return energy, state


def discretized(rod, basis, n_terms=5, gravity=GRAVITY, **more):
    s = np.array([0, 0.02, 0.1, 0.2, 0.4, 0.5, 0.8, 1.0, 1.1, 1.3]) / 1.3 * rod.length
    return Discretization(Surroundings(rod, gravity, **more), s, basis, n_terms)


def plain(curly, basis, rng):
    return discretized(curly, basis).system(BASE)


def anchored(curly, basis, rng):
    return plain(curly, basis, rng)._replace(anchor=InertiaTerm(rng.normal(size=(10, 3)),
                                                                rng.uniform(0, 3, size=10)))


def everything(curly, basis, rng):
    """Return a system with every effect at once; obstacles push at nodes."""
    system = touching(curly, basis, rng)
    none, empty = np.zeros((0, 3)), np.zeros(0)
    system = system._replace(contacts=ContactSet(
        2.0, system.contacts.node, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), empty,
        empty, none, none, none, 0.5))
    other = held(curly, basis, rng)
    return system._replace(hold=other.hold, anchor=anchored(curly, basis, rng).anchor,
                           plastic=plastic(curly, basis, rng).plastic)


def held(curly, basis, rng):
    end = FarEnd(Pose((0.3, 0.2, 0.1), (0.1, 0.2, 0.3, 0.9)), 'sleeve')
    system = discretized(curly, basis).system(BASE, (0.1, 0, 0), holds=(end,))
    system.hold.multiplier[:] = rng.normal(size=5)
    return system._replace(hold=system.hold._replace(stiffness=3.0, turn_stiffness=2.0))


def plastic(curly, basis, rng):
    rod = Rod(1.3, 0.2, (0.3, 0.8), 0.4, natural_curvature=(1.0, -0.5), yield_curvature=(0.4, 0.7),
              yield_torsion=0.5, section_model='round', hardening=0.1)
    here = discretized(rod, basis)
    past = replace(here.start, plastic=0.1 * rng.normal(size=here.start.plastic.shape))
    return here.system(BASE, memory=past)


def touching(curly, basis, rng):
    """Return a system in which every obstacle and a point of friction pushes somewhere."""
    hole = CutOut(Pose.looking_along((0.1, 0.2, 0.3), (1, 1, 0)), radius=0.15)
    obstacles = [Plane((0, 0, -0.3), (0.1, 0, 1)), Sphere((0.2, 0.1, 0.1), 0.1),
                 Capsule((0.2, 0, 0), (0.3, 0.4, 0.1), 0.07),
                 Box(Pose((0, 0.3, 0), (0.1, 0.2, 0.3, 0.9)), (0.1, 0.2, 0.3)),
                 Sheet.around(hole, 0.6, 0.8, 0.0)]
    rod = Rod(1.3, 0.2, (0.3, 0.8), 0.4, natural_curvature=(1.0, -0.5), radius=0.02)
    system = discretized(rod, basis, obstacles=obstacles).system(BASE, (0.1, 0, 0.2))
    elements = np.array([1, 2, 4, 4, 6, 7, 8])
    normals = np.tile([0, 0.6, 0.8], (7, 1))
    shears = np.cross(normals, 0.1 * rng.normal(size=(7, 3)))
    contacts = ContactSet(2.0, rng.uniform(0, 1.5, size=(5, 10)), elements,
                          np.array([0, 1, -1, 2, 3, 4, 1]), rng.uniform(1, 2, 7),
                          rng.uniform(0.2, 0.8, 7), rng.normal(size=(7, 3)),
                          normals, shears, 0.5)
    return system._replace(contacts=contacts)


def broad(curly, basis, rng):
    """Return a system in which edges and faces of a rectangular section are pushed."""
    # none is so near that it could be on the axis, where distances have no derivative
    obstacles = [Plane((0, 0, -0.3), (0.1, 0, 1)), Sphere((1.9, 0.1, 0.1), 0.3),
                 Capsule((0.2, 1.8, 0), (0.3, 1.9, 0.9), 0.2),
                 Box(Pose((0.1, -1.9, 0), (0.1, 0.2, 0.3, 0.9)), (0.1, 0.2, 0.3))]
    section = Section.of('rectangular', 0.15, 0.1, 1e3, 0.3)
    rod = Rod(1.3, 0.2, (0.3, 0.8), 0.4, natural_curvature=(1.0, -0.5), radius=0.15,
              section=section)
    system = discretized(rod, basis, obstacles=obstacles).system(BASE, (0.1, 0, 0.2))
    bodies = np.arange(system.scene.kind.size)
    assert set(system.scene.feature) == {EDGE, FACE, NODE_FACE}
    elements = np.sort(rng.integers(0, 9, bodies.size))
    none = np.zeros((bodies.size, 3))
    pushed = np.maximum(rng.uniform(-0.5, 0.06, size=(bodies.size, 10)), 0)
    contacts = ContactSet(0.02, pushed, elements, rng.permutation(bodies),
                          rng.uniform(0.05, 0.06, bodies.size),
                          np.zeros(bodies.size), none, none, none, 0.5)
    return system._replace(contacts=contacts)


def tapered(curly, basis, rng):
    system = touching(curly, basis, rng)
    radii = rng.uniform(0.01, 0.05, size=(9, 2))
    return system._replace(scene=system.scene._replace(radii=radii))


def tied(curly, basis, rng):
    system = plain(curly, basis, rng)
    return system._replace(proximal_point=rng.normal(size=new_configuration(system).q.shape),
                           proximal_weight=0.7)


KINDS = (plain, anchored, held, plastic, touching, broad, tapered, tied, everything)


@pytest.fixture(params=[(kind, basis) for kind in KINDS for basis in ('local', 'chebyshev')]
                + [(plain, 'fourier')],
                ids=lambda case: f'{case[0].__name__}-{case[1]}')
def system(request, curly, rng):
    kind, basis = request.param
    return kind(curly, basis, rng)


def test_gradient_against_differences(system, rng):
    q = rng.normal(size=new_configuration(system).q.shape)
    _, state = at(system, q)
    step = 4e-6  # less is lost to rounding: potentials of all effects are large
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = step
        slope = (at(system, q + change)[0] - at(system, q - change)[0]) / (2 * step)
        assert state.gradient[index] == pytest.approx(slope, abs=1e-8)


@pytest.mark.every(4)
def test_hessian_against_differences(system, rng):
    q = rng.normal(size=new_configuration(system).q.shape)
    _, state = at(system, q)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    matrix, step = dense(system, hessian).reshape(*q.shape, *q.shape), 1e-6
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = 1.0
        column = matrix[(..., *index)]
        up, down = (at(system, q + sign * step * change)[1].gradient for sign in (1, -1))
        np.testing.assert_allclose(column, (up - down) / (2 * step), atol=1e-8)


def test_base_moment_and_its_derivative_against_differences(system, rng):
    q = rng.normal(size=new_configuration(system).q.shape)
    _, state = at(system, q)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    step = 1e-6
    for axis in range(3):
        turned = []
        for sign in (1, -1):
            turn = Rotation.from_rotvec(sign * step * np.eye(3)[axis]).as_matrix()
            turned.append(at(system._replace(base=turn @ BASE), q))
        slope = (turned[0][0] - turned[1][0]) / (2 * step)
        assert state.base_moment[axis] == pytest.approx(slope, abs=1e-7)
        if hessian.twist_jacobian.shape[1] > 3:
            continue  # the rate is that of dead loads only
        rate = (turned[0][1].base_moment - turned[1][1].base_moment) / (2 * step)
        np.testing.assert_allclose(hessian.base[:, axis], rate, atol=1e-7)


def test_what_rounding_has_left_of_strains_is_none():
    # else products of it are denormal: a step of a wire across a table took 1.5 times as long
    system = discretized(Rod.circular(1.0, 1e-3, 1000.0, 1e6, 0.3), 'local').system(BASE)
    q = np.empty((9, 3))
    unknowns_of(system, system.natural + np.outer(np.ones(9), [1e-100, 1e-20, 1.0]), q)
    assert np.all(q[:, 0] == 0.0)
    assert np.all(q[:, 1:] != 0.0)


def test_elastic_energy_is_half_the_square_of_the_unknowns(curly, rng):
    system = discretized(curly, 'chebyshev', 4, np.zeros(3)).system(np.eye(3))
    q = rng.normal(size=(4, 3))
    energy, state = at(system, q)
    assert energy == pytest.approx(0.5 * np.sum(q**2))
    np.testing.assert_allclose(state.gradient, q, atol=1e-12)


def test_the_rounding_scale_is_that_of_the_terms(curly, rng):
    # large terms that cancel leave large rounding errors
    system = discretized(curly, 'chebyshev').system(BASE)
    state = new_configuration(system)
    state.q[:] = rng.normal(size=state.q.shape)
    _, noise = evaluate(system, state)
    terms = np.abs(system.pull * state.positions).sum()
    assert 1e-16 * terms < noise < 1e-14 * (terms + np.sum(state.q**2))


S = np.array([0, 0.1, 0.4, 0.45, 0.9, 1.2, 1.3])


@pytest.mark.parametrize('where', [0.0, 0.13, 0.39, 0.4, 1.29, 1.3])
def test_a_point_mass_keeps_its_place_on_an_uneven_mesh(where):
    masses = node_masses(Rod(1.3, 0.0, 1.0, 1.0, point_masses=((where, 0.3),)), S)
    assert masses.sum() == pytest.approx(0.3)
    assert masses @ S == pytest.approx(0.3 * where)
    near = np.abs(S - where)
    assert (masses[near > 0.5] == 0).all() and (masses >= 0).all()


def test_masses_on_an_uneven_mesh_keep_the_first_moment():
    rod = Rod(1.3, lambda s: 1.0 + s, 1.0, 1.0, tip_mass=0.7, point_masses=((0.2, 0.5),))
    h, middle = np.diff(S), 0.5 * (S[1:] + S[:-1])
    masses = node_masses(rod, S)
    assert masses.sum() == pytest.approx(np.sum(h * (1 + middle)) + 1.2)
    assert masses @ S == pytest.approx(1.3**2 / 2 + 1.3**3 / 3 + 0.7 * 1.3 + 0.5 * 0.2)


def around(**more):
    return Surroundings(Rod(1.3, 0.1, 1.0, 1.0), (0.0, 0.0, -9.81), **more)


@pytest.mark.parametrize(('load', 'power'), [
    ((1.0, -2.0, 3.0), (0, 0, 0)), (lambda s: (1.0, -2.0 * s, 3.0 * s**2), (0, 1, 2))],
    ids=['even', 'varies'])
def test_a_distributed_load_keeps_force_and_moment(load, power):
    forces, power = node_forces(around(load=load), S), np.array(power)
    size = np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(forces.sum(axis=0), size * 1.3 ** (power + 1) / (power + 1))
    np.testing.assert_allclose(S @ forces, size * 1.3 ** (power + 2) / (power + 2))


def test_point_loads_keep_force_moment_and_place():
    loads = [PointLoad((1.0, 2.0, 3.0), s=0.5), PointLoad((0.0, 0.0, -1.0), (0.0, 0.3, 0.0))]
    forces, moments = (what(around(point_loads=loads), S) for what in (node_forces, node_moments))
    np.testing.assert_allclose(forces.sum(axis=0), (1.0, 2.0, 2.0))
    np.testing.assert_allclose(S @ forces, (0.5, 1.0, 1.5 - 1.3))
    np.testing.assert_array_equal(moments[-1], (0.0, 0.3, 0.0))
