# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact: against beams and shooting, Coulomb's law, balance of forces; nothing is run through."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    InvalidTask,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.energy.gap import signed_distance
from dlo_planner.energy.scene import build_scene

LEVEL = (0.0, 0.0, 0.0, 1.0)


def lowered(simulator, heights, initial=None):
    return simulator.track([Pose((0, 0, z), LEVEL) for z in heights], initial=initial)


def balance(rod, shape):
    weight = (rod.mass_per_length * rod.length + rod.tip_mass) * 9.81
    pushed = sum((contact.vector for contact in shape.contacts), np.zeros(3))
    return np.linalg.norm(shape.gripper_wrench[:3] + pushed - [0, 0, weight]) / weight


def moments(rod, shape):
    """Return what is left of all moments about the gripper."""
    at = shape.gripper.position
    middle = 0.5 * (shape.positions[1:] + shape.positions[:-1])
    mass = rod.mass_per_length * np.diff(shape.s)
    total = shape.gripper_wrench[3:] + np.cross(middle - at,
                                                mass[:, None] * [0, 0, -9.81]).sum(axis=0)
    for contact in shape.contacts:
        total = total + np.cross(contact.position - at, contact.vector)
    return np.linalg.norm(total)


def depth_everywhere(simulator, shape):
    """Return how far the DLO is inside an obstacle, looked at closely along its arcs."""
    scene = build_scene(simulator.obstacles, simulator.rod.radius)
    normal, bend = np.empty(3), np.empty((3, 3))
    places = [np.array(shape.at(s).position) for s in np.linspace(0.01, shape.s[-1], 1500)]
    gaps = [signed_distance(scene, o, place, normal, bend) - simulator.rod.radius
            for place in places for o in range(len(simulator.obstacles))]
    return max(0.0, -min(gaps))


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_weightless_rod_on_a_peg_against_shooting(basis):
    # Up to the peg an elastica with a force across its end, beyond it straight.
    stiffness, radius, peg = 0.3, 0.004, 0.01
    center = np.array([0.5, 0.0, -0.12])
    rod = Rod(1.0, 0.0, stiffness, 0.2, radius=radius)
    bar = Capsule(center + [0, -0.3, 0.3], center + [0, 0.3, 0.3], peg)
    simulator = DirectSimulator(rod, basis=basis, n_elements=128, n_terms=24 if basis != 'local'
                                else None, gravity=(0, 0, 0), obstacles=[bar])
    # the gripper comes up to the peg from below, so that the peg ends 0.12 m below its axis
    shape = simulator.track([Pose((0, 0, z), LEVEL) for z in np.linspace(0, 0.3, 7)])[-1]
    assert shape.converged
    assert len(shape.contacts) == 1
    gap = center + [0, 0, 0.3] - [0, 0, 0.3]

    def end(unknown):
        force, length, angle = unknown

        def slope(_, y):
            lever = np.cross([at[0] - y[0], 0, at[1] - y[1]], across * force)[1]
            return [np.cos(y[2]), np.sin(y[2]), -lever / stiffness]

        at = (gap[0] - (peg + radius) * -np.sin(angle), gap[2] - (peg + radius) * np.cos(angle))
        across = np.array([np.sin(angle), 0, -np.cos(angle)])  # the peg pushes downwards
        found = solve_ivp(slope, (0, length), [0, 0, 0], rtol=1e-11, atol=1e-12).y[:, -1]
        return [found[0] - at[0], found[1] - at[1], found[2] - angle]

    contact = shape.contacts[0]
    angle = np.arctan2(*(shape.at(contact.s).direction[[2, 0]]))
    force, length, angle = fsolve(end, [contact.force, contact.s, angle], xtol=1e-12)
    assert contact.force == pytest.approx(force, rel=1e-4)
    assert contact.s == pytest.approx(length, abs=2e-6)
    assert depth_everywhere(simulator, shape) < 1e-8


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_wire_laid_on_a_floor_against_the_beam(wire, basis):
    # A beam lifted by H touches down where its slope and curvature vanish: H = w l^4 / (72 EI).
    height = 0.004
    simulator = DirectSimulator(wire, basis=basis, n_elements=200, n_terms=None if basis == 'local'
                                else 30, obstacles=[Plane((0, 0, 0), (0, 0, 1))])
    shape = lowered(simulator, [0.05, 0.02, height + wire.radius])[-1]
    assert shape.converged
    weight = wire.mass_per_length * 9.81
    lifted = (72 * wire.bending_stiffness[0] * height / weight) ** 0.25
    first = min(contact.s for contact in shape.contacts)
    assert first == pytest.approx(lifted, abs=1.5 / 200)
    # at the gripper the beam's root moment is w l^2 / 6 ...
    moment = wire.bending_stiffness[0] * np.hypot(*shape.strains[0, 1:])
    assert moment == pytest.approx(weight * lifted**2 / 6, rel=0.02)
    assert balance(wire, shape) < 1e-9
    assert depth_everywhere(simulator, shape) < 1e-5


@pytest.mark.every(3)
@pytest.mark.parametrize('obstacle', [
    Capsule((0.35, -0.5, 0.7), (0.35, 0.5, 0.7), 0.03),
    Capsule((0.35, -0.5, 0.7), (0.35, 0.5, 0.7), 0.001),
    Box(Pose((0.4, 0, 0.65), LEVEL), (0.1, 0.4, 0.1)),
    Sheet(Pose.looking_along((0.4, 0, 0.7), (0, 0, 1)), 0.2, 0.4, 0.001)],
    ids=['bar', 'thin bar', 'box', 'thin sheet'])
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_forces_balance_and_nothing_is_entered(wire, obstacle, basis):
    simulator = DirectSimulator(wire, basis=basis, obstacles=[obstacle])
    for shape in lowered(simulator, np.arange(0.92, 0.6, -0.08)):
        assert shape.converged and not shape.jumped
        assert shape.contacts and all(c.force > 0 for c in shape.contacts)
        assert balance(wire, shape) < 1e-9
        assert moments(wire, shape) < 1e-9 * wire.mass_per_length * 9.81
        assert max(c.penetration for c in shape.contacts) < 1e-8
        assert depth_everywhere(simulator, shape) < 1e-4
        assert shape.stability > 0


def test_benchmark_d_needs_the_step_before(wire):
    bar = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
    simulator = DirectSimulator(wire, obstacles=[bar])
    heights = np.linspace(0.95, 0.6, 9)
    for shape in lowered(simulator, heights):
        assert shape.converged and not shape.jumped
        assert np.interp(0.3, shape.positions[:, 0], shape.positions[:, 2]) > 0.7
    alone = [simulator.solve(Pose((0, 0, z), LEVEL)) for z in heights]
    above = [np.interp(0.3, s.positions[:, 0], s.positions[:, 2]) > 0.7 for s in alone]
    assert above[0] and not above[-1]
    assert all(shape.converged for shape in alone)  # valid shapes, of the wrong branch


@pytest.mark.parametrize('obstacle', [
    Box(Pose((0.4, 0, 0.49), LEVEL), (0.05, 1.0, 0.02)),
    Capsule((0.4, -1, 0.5), (0.4, 1, 0.5), 0.0005),
    Sheet(Pose.looking_along((0.4, 0, 0.5), (0, 0, 1)), 1.0, 0.2, 0.0)],
    ids=['bar', 'needle', 'foil'])
def test_a_long_step_does_not_tunnel(obstacle):
    rod = Rod(1.0, 0.05, 0.5, 0.4, radius=0.001)
    simulator = DirectSimulator(rod, basis='local', obstacles=[obstacle])
    shape = simulator.solve(Pose((0, 0, 0.6), LEVEL))
    for height in (0.52, 0.42):
        shape = simulator.solve(Pose((0, 0, height), LEVEL), shape)
        assert np.interp(0.4, shape.positions[:, 0], shape.positions[:, 2]) > 0.499
    assert shape.converged and shape.contacts


def test_a_dlo_in_a_hole_stays_in_it(wire):
    hole = CutOut(Pose.looking_along((0.3, 0, 0.95), (1, 0, 0)), radius=0.01)
    short = Rod.circular(0.5, 1e-3, 8960.0, 110e9, 0.34)
    plate = Sheet.around(hole, thickness=2e-3)
    simulator = DirectSimulator(short, basis='local', obstacles=[plate])
    shape = None
    for offset in np.linspace(0, 0.05, 6):
        gripper = Pose((0.0, offset, 0.95 + offset), LEVEL)
        shape = simulator.solve(gripper, shape)
        assert shape.converged
        crossing = np.array([np.interp(0.3, shape.positions[:, 0], column)
                             for column in shape.positions[:, 1:].T])
        assert np.linalg.norm(crossing - [0, 0.95]) < 0.01
        assert depth_everywhere(simulator, shape) < 1e-4
    assert shape.contacts


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_friction_holds_back_a_wire_drawn_over_the_floor(wire, basis):
    weight = wire.mass_per_length * 9.81
    simulator = DirectSimulator(wire, basis=basis, obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    height = wire.radius + 1e-3
    shape = lowered(simulator, [0.05, 0.01, height])[-1]
    for x in (-0.001, -0.01, -0.02):
        shape = simulator.solve(Pose((x, 0, height), LEVEL), shape)
    assert shape.converged
    on_floor = sum(contact.force for contact in shape.contacts)
    assert on_floor > 0.6 * weight
    friction = sum(contact.friction for contact in shape.contacts)
    np.testing.assert_allclose(friction, [0.3 * on_floor, 0, 0], atol=2e-3 * weight)
    assert balance(wire, shape) < 1e-9
    # pushed back by less than the springs of friction give, it does not turn round
    back = simulator.solve(Pose((-0.02 + 1e-9, 0, height), LEVEL), shape)
    assert sum(contact.friction for contact in back.contacts)[0] > 0


@pytest.mark.sweep
def test_contact_in_motion_comes_to_rest_as_statics_say(wire):
    damped = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, damping=(8.0, 0.02))
    bar = Capsule((0.35, -0.5, 0.75), (0.35, 0.5, 0.75), 0.03)
    simulator = DirectSimulator(damped, obstacles=[bar])
    start = simulator.solve(Pose((0, 0, 1.0), LEVEL))
    heights = np.concatenate([np.linspace(1.0, 0.9, 20), np.full(60, 0.9)])
    motion = simulator.simulate([Pose((0, 0, z), LEVEL) for z in heights], 0.03, start)
    assert motion.converged
    rest = simulator.solve(Pose((0, 0, 0.9), LEVEL), start)
    np.testing.assert_allclose(motion.shapes[-1].positions, rest.positions, atol=1e-4)
    assert all(depth_everywhere(simulator, shape) < 1e-4 for shape in motion.shapes[::10])


def test_sheets_need_a_thickness_of_the_dlo():
    sheet = Sheet(Pose.identity(), 1.0, 1.0)
    with pytest.raises(InvalidTask, match='radius'):
        DirectSimulator(Rod(1.0, 0.1, 1.0, 1.0), obstacles=[sheet])
    with pytest.raises(InvalidTask, match=r'obstacles\[0\] = 3'):
        DirectSimulator(Rod(1.0, 0.1, 1.0, 1.0), obstacles=[3])


def test_a_gripper_in_the_floor_is_no_answer(wire, level):
    simulator = DirectSimulator(wire, basis='local', obstacles=[Plane((0, 0, 1.2), (0, 0, 1))])
    assert not simulator.solve(level).converged


@pytest.mark.parametrize('floor', [Plane((0, 0, 0), (0, 0, 1)), Sphere((0, 0, -0.3), 0.3),
                                   Box(Pose((0, 0, -0.1), LEVEL), (0.4, 0.4, 0.2))])
@pytest.mark.parametrize('depth', [-4e-4, 1e-4, 8e-3])
def test_a_gripper_just_below_the_surface_is_no_answer(wire, floor, depth):
    # the first free node is outside: nothing else tells that the DLO begins inside
    simulator = DirectSimulator(wire, basis='local', n_elements=32, obstacles=[floor])
    above = simulator.solve(Pose.looking_along((0, 0, 0.2), (0, 0, 1)))
    shape = simulator.track([Pose.looking_along((0, 0, -depth), (0.3, 0, 1))], initial=above)[0]
    assert shape.converged == (depth < 0)
    assert shape.violation == pytest.approx(max(depth, 0.0), abs=1e-12)
