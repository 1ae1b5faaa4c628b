# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces and moments inside a DLO: closed forms, and an integration of the Kirchhoff equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from dlo_planner import DirectSimulator, FarEnd, Hold, InvalidTask, Plane, PointLoad, Pose, Rod
from dlo_planner.results import SectionForces
from dlo_planner.rods import GraspedInside

LEVEL = Pose.identity()
WEIGHT = 9.81
STEEL = Rod(1.0, 0.3, (0.5, 1.5), 0.4, natural_curvature=(0.4, -0.7), natural_twist=0.5)


def test_a_limp_cable_hangs_as_a_catenary():
    span, weight = 0.8, 0.1 * WEIGHT
    cable = Rod(1.0, 0.1, 1e-6, 1e-6)
    simulator = DirectSimulator(cable, basis='local', n_elements=200, grip='pinned')
    shape = simulator.solve(LEVEL, far_end=FarEnd(Pose((span, 0, 0), (0, 0, 0, 1)), 'pinned'))
    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - 1, 0.05, 5)
    x = a * np.arcsinh((shape.s - 0.5) / a)
    np.testing.assert_allclose(shape.tension, weight * a * np.cosh(x / a), rtol=2e-4)
    assert np.abs(shape.shear).max() < 0.01 * shape.tension.min()


def test_a_cantilever_bears_shear_and_moment_of_what_is_beyond():
    # linear beam theory: bent by 1e-4 of its length
    rod = Rod(1.0, 1e-4, 1.0, 1.0)
    shape = DirectSimulator(rod, basis='local', n_elements=50).solve(LEVEL)
    weight, left = 1e-4 * WEIGHT, 1 - shape.s
    np.testing.assert_allclose(shape.shear[:, 1], -weight * left, atol=1e-7 * weight)
    np.testing.assert_allclose(shape.bending_moment[:, 0], weight * left**2 / 2,
                               atol=1e-7 * weight)
    np.testing.assert_allclose(shape.tension, 0, atol=1e-3 * weight)
    assert not shape.shear[:, 0].any() and np.abs(shape.torque).max() < 1e-12 * weight


def integrated(rod, shape, gravity=(0.0, 0.0, -WEIGHT)):
    """Return (m, 18) positions, axes, forces and moments at shape.s, by the Kirchhoff equations.

    Begun at the gripper with the wrench that it exerts; world axes.
    """
    load = rod.mass_per_length * np.array(gravity)

    def slope(s, y):
        frame, force, moment = y[3:12].reshape(3, 3), y[12:15], y[15:]
        strain = (frame.T @ moment) / rod.stiffness + rod.natural_strains([s])[0]
        turn = np.cross(frame @ strain, frame, axisa=0, axisb=0, axisc=0)
        return np.concatenate([frame[:, 0], turn.ravel(), -load, -np.cross(frame[:, 0], force)])

    first = [*shape.positions[0], *shape.frames[0].ravel(), *-shape.gripper_wrench]
    found = solve_ivp(slope, (0, shape.s[-1]), first, t_eval=shape.s, rtol=1e-10, atol=1e-11)
    return found.y.T


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_an_elastica_in_two_grips_is_that_of_the_kirchhoff_equations(basis):
    end = FarEnd(Pose((0.7, 0.15, -0.1), (0.1, 0.0, 0.3, 0.9)))
    shape = DirectSimulator(STEEL, basis=basis, n_elements=256, n_terms=24).solve(
        LEVEL, far_end=end)
    assert shape.converged
    true = integrated(STEEL, shape)
    np.testing.assert_allclose(shape.positions, true[:, :3], atol=2e-4)
    frames = true[:, 3:12].reshape(-1, 3, 3)
    for found, there in ((np.column_stack([shape.tension, shape.shear]), true[:, 12:15]),
                         (np.column_stack([shape.torque, shape.bending_moment]), true[:, 15:])):
        wanted = np.einsum('kij,ki->kj', frames, there)
        np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())
    force, moment = np.split(shape.far_wrench, 2)
    inside = shape.section_forces
    np.testing.assert_allclose(shape.frames[-1] @ inside.force[-1], force,
                               atol=1e-8 * np.linalg.norm(force))
    np.testing.assert_allclose(shape.frames[0] @ inside.moment[0], -shape.gripper_wrench[3:],
                               atol=1e-8 * np.linalg.norm(moment))


def jumps(inside, values):
    """Return {s: jump (3,)} of the values beyond a place, less those before it."""
    places = inside.s[1:-1].reshape(-1, 2)
    np.testing.assert_array_equal(places[:, 0], places[:, 1])
    change = np.diff(values[1:-1].reshape(-1, 2, 3), axis=1)[:, 0]
    large = np.linalg.norm(change, axis=1) > 1e-9
    return dict(zip(places[large, 0].tolist(), change[large], strict=True))


def test_they_jump_where_something_acts_and_nowhere_else():
    force, moment, mass = np.array([0.2, 0.5, -0.3]), np.array([0.1, -0.2, 0.3]), 0.2
    rod = Rod(1.0, 0.3, 1.0, 0.8, point_masses=((0.333, mass),))
    shape = DirectSimulator(rod, n_elements=40, basis='local', point_loads=[
        PointLoad(force, s=0.61), PointLoad(moment=moment, s=0.25)]).solve(LEVEL)
    inside = shape.section_forces
    found = jumps(inside, inside.force)
    assert list(found) == pytest.approx([0.333, 0.61])
    for s, acting in ((0.333, mass * np.array([0, 0, -WEIGHT])), (0.61, force)):
        np.testing.assert_allclose(shape.at(s).rotation @ found[min(found, key=lambda at: abs(
            at - s))], -acting, atol=1e-9)  # the part beyond the place pulls no more with it
    turned = jumps(inside, inside.moment)
    assert list(turned) == pytest.approx([0.25])
    np.testing.assert_allclose(shape.at(0.25).rotation @ turned[0.25], -moment, atol=1e-9)


def test_a_hold_inside_parts_what_is_before_and_beyond_it():
    clip = Hold(Pose((0.45, 0, 0.1), (0, 0, 0, 1)), 'clamped', 0.5)
    shape = DirectSimulator(Rod(1.0, 0.3, 1.0, 0.8), n_elements=40).solve(LEVEL, holds=[clip])
    inside = shape.section_forces
    at = int(np.flatnonzero(inside.s == 0.5)[0])
    # beyond it there is a cantilever of half the length
    np.testing.assert_allclose(inside.force[at + 1], [0, 0, -0.15 * WEIGHT], atol=1e-9)
    frame = shape.at(0.5).rotation
    for values, wrench in ((inside.force, shape.wrenches[0, :3]),
                           (inside.moment, shape.wrenches[0, 3:])):
        np.testing.assert_allclose(frame @ (values[at] - values[at + 1]), wrench,
                                   atol=1e-8 * np.linalg.norm(shape.wrenches))
    node = int(np.flatnonzero(shape.s == 0.5)[0])
    assert shape.tension[node] == pytest.approx(inside.tension[at:at + 2].mean())


def test_grasped_inside_both_parts_are_cantilevers():
    rod = Rod(1.0, 1e-4, 1.0, 1.0)
    shape = GraspedInside(rod, 0.4, basis='local', n_elements=40).solve(LEVEL)
    weight, s = 1e-4 * WEIGHT, shape.section_forces.s
    beyond, before = s >= 0.4, s <= 0.4
    left = np.flatnonzero(s == 0.4)
    beyond[left[0]], before[left[1]] = False, False
    shear = shape.section_forces.shear[:, 1]
    np.testing.assert_allclose(shear[beyond], -weight * (1 - s[beyond]), atol=1e-6 * weight)
    np.testing.assert_allclose(shear[before], weight * s[before], atol=1e-6 * weight)
    bent = shape.section_forces.bending_moment[:, 0]
    np.testing.assert_allclose(bent[beyond], weight * (1 - s[beyond])**2 / 2, atol=1e-6 * weight)
    np.testing.assert_allclose(bent[before], weight * s[before]**2 / 2, atol=1e-6 * weight)


def test_a_varying_load_counts_along_the_elements():
    rod = Rod(1.0, 0.0, 1.0, 1.0)
    shape = DirectSimulator(rod, basis='local', n_elements=50, gravity=(0, 0, 0),
                            load=lambda s: (0, 0, -1e-3 * s)).solve(LEVEL)
    np.testing.assert_allclose(shape.shear[:, 1], -1e-3 * (1 - shape.s**2) / 2, atol=1e-7)


@pytest.mark.parametrize('friction', [0.0, 0.6])
def test_a_table_bears_what_it_takes(friction):
    floor = Plane((0, 0, -0.05), (0, 0, 1), friction)
    cable = Rod(1.0, 0.05, 3e-3, 2e-3, radius=2e-3)
    simulator = DirectSimulator(cable, obstacles=[floor], basis='local', n_elements=40)
    shape = simulator.track([Pose((0, 0, z), (0, 0, 0, 1)) for z in (0.0, -0.01)])[-1]
    inside = shape.section_forces
    places = [round(contact.s, 12) for contact in shape.contacts]
    assert shape.converged and places[-1] == 1.0  # the tip's is no jump between two sides
    assert list(jumps(inside, inside.force)) == pytest.approx(places[:-1])
    for contact in shape.contacts[:-1]:
        at = int(np.abs(inside.s - contact.s).argmin())
        frame = shape.at(contact.s).rotation
        np.testing.assert_allclose(frame @ (inside.force[at] - inside.force[at + 1]),
                                   contact.vector, atol=1e-7)
    np.testing.assert_allclose(shape.frames[0] @ inside.moment[0], -shape.gripper_wrench[3:],
                               atol=1e-8)


def test_contacts_beside_the_axis_of_a_strip_bend_and_twist_it():
    strip = Rod.rectangular(1.0, 0.02, 1e-3, 7800.0, 2e11, 0.3)
    floor = Plane((0, 0, -0.02), (0, 0, 1))
    shape = DirectSimulator(strip, basis='local', n_elements=64, obstacles=[floor]).track(
        [Pose((0, 0, 0), (np.sin(0.2), 0, 0, np.cos(0.2)))])[-1]
    inside = shape.section_forces
    assert shape.contacts and shape.converged
    moment = shape.frames[0] @ inside.moment[0]
    np.testing.assert_allclose(moment, -shape.gripper_wrench[3:],
                               atol=2e-3 * np.linalg.norm(moment))
    np.testing.assert_allclose(inside.moment[-1], 0, atol=2e-3 * np.linalg.norm(moment))
    arms = np.linalg.norm(list(jumps(inside, inside.moment).values()), axis=1)
    assert arms.max() > 1e-3 * max(contact.force for contact in shape.contacts)


def test_where_they_are_not_known_that_is_said(tmp_path):
    simulator = DirectSimulator(STEEL, n_elements=16)
    shape = simulator.solve(LEVEL)
    shape.save(tmp_path / 'shape.npz')
    with pytest.raises(InvalidTask, match='does not know its rod'):
        _ = type(shape).load(tmp_path / 'shape.npz').tension
    motion = simulator.simulate([LEVEL, Pose((0.1, 0, 0), (0, 0, 0, 1))], 0.1)
    with pytest.raises(InvalidTask, match=r'leave .* N over: expected a converged one at rest'):
        _ = motion.shapes[-1].shear


def test_what_is_made_by_hand_is_looked_at():
    with pytest.raises(InvalidTask, match=r'SectionForces\.force'):
        SectionForces([0.0, 1.0], np.zeros((3, 3)), np.zeros((2, 3)), 0.0)
