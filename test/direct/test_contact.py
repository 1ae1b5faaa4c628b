# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact: against beams and shooting, Coulomb's law, balance of forces; nothing is run through."""

from copy import deepcopy

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    DirectSimulator,
    Ellipsoid,
    FarEnd,
    InvalidRod,
    InvalidTask,
    Plane,
    PointLoad,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.direct.shape import pack
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.scene import build_scene, signed_distance
from dlo_planner.rods import with_plug

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


@pytest.mark.every(2)
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


@pytest.mark.every(5)
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
        assert [c.s for c in shape.contacts] == sorted(c.s for c in shape.contacts)
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


@pytest.mark.parametrize('hole', [{'radius': 0.01}, {'width': 0.02, 'height': 0.02}])
@pytest.mark.parametrize('short', [0.004, 0.012, 0.02])
def test_a_tip_in_a_thick_sheet_leans_on_the_wall_of_the_hole(hole, short):
    stiff = Rod.circular(0.5, 2e-3, 8960.0, 110e9, 0.34)
    place = Pose.looking_along((0.5 - short + 0.012, 0, 1.0), (1, 0, 0))
    sheet = Sheet.around(CutOut(place, **hole), thickness=0.024)
    simulator = DirectSimulator(stiff, gravity=(0, 0, 0), obstacles=[sheet])
    shape = None
    for yaw in np.linspace(0, 0.03, 7):
        shape = simulator.solve(Pose.looking_along((0, 0, 1), (1, yaw, 0)), shape)
        assert shape.converged
        assert shape.positions[-1, 1] < 0.01 - stiff.radius + 1e-6
    assert shape.contacts and shape.contacts[-1].normal[1] == pytest.approx(-1)


@pytest.mark.parametrize(('thickness', 'deep'), [(0.1, 0.02), (0.1, 0.07), (0.024, 0.004)])
def test_a_tip_does_not_pass_from_one_hole_to_the_next(thickness, deep):
    stiff = Rod.circular(0.5, 2e-3, 8960.0, 110e9, 0.34)
    holes = [CutOut(Pose.looking_along((0.5 + thickness / 2 - deep, y, 1.0), (1, 0, 0)),
                    radius=0.01) for y in (0.0, 0.03)]
    sheet = Sheet(holes[0].pose, 0.4, 0.4, thickness, holes)
    simulator = DirectSimulator(stiff, gravity=(0, 0, 0), obstacles=[sheet], n_elements=40,
                                basis='local')
    shape = simulator.solve(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    for aside in (0.025, 0.03):  # at once
        there = simulator.solve(Pose.looking_along((0, aside, 1), (1, 0, 0)), shape)
        assert there.converged and there.contacts and there.positions[-1, 1] < 0.01


@pytest.mark.every(2)
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

    # Pushed back by less than what makes it slide the other way, it sticks: friction falls as the
    # way grows. How steeply depends on how many contacts the bow behind the gripper ends at.
    def friction_after(way):
        back = simulator.solve(Pose((-0.02 + way, 0, height), LEVEL), shape)
        assert back.converged
        return sum(contact.friction for contact in back.contacts)[0]

    steepness = (friction[0] - friction_after(1e-10)) / 1e-10
    half = 0.5 * friction[0]
    assert friction_after(half / steepness) == pytest.approx(half, rel=0.02)


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


# ------------------------------------------------------------------------------------------------
# Friction.


SLIDING = [(-0.002, 0.001, 0.01), (-0.006, 0.003, 0.01)]
STICKING = [(-1e-7, 0, 0.01), (-1.5e-7, 0, 0.01), (-1e-7, 0, 0.01)]


def drawn(wire, shift, way):
    """Return the friction in N that a wire feels, lowered to a floor and drawn over it."""
    shift = np.array(shift)
    direct = DirectSimulator(wire, basis='local', n_elements=32,
                             obstacles=[Plane(shift, (0, 0, 1), 0.3)])
    shapes = direct.track([Pose(shift + x, (0, 0, 0, 1))
                           for x in [(0, 0, 0.05), (0, 0, 0.01), *way]])
    assert all(shape.converged for shape in shapes)
    return np.array([sum(contact.friction for contact in shape.contacts) for shape in shapes[2:]])


@pytest.mark.parametrize('way', [SLIDING, STICKING], ids=['sliding', 'sticking'])
def test_friction_does_not_ask_where_the_world_begins(wire, way):
    here, there = drawn(wire, (0, 0, 0), way), drawn(wire, (3.0, -2.0, 1.0), way)
    weight = wire.mass_per_length * 9.81
    np.testing.assert_allclose(there, here, atol=1e-5 * weight)
    assert np.linalg.norm(here[-1]) > 0.1 * weight


def test_friction_holds_against_the_way_and_what_sticks_goes_back(wire):
    weight = wire.mass_per_length * 9.81
    slid = drawn(wire, (0, 0, 0), SLIDING)[-1]
    assert slid @ [1, -0.5, 0] > 0.1 * weight
    stuck = drawn(wire, (0, 0, 0), STICKING)
    assert abs(stuck[1, 0] - stuck[0, 0]) > 0.01 * weight
    np.testing.assert_allclose(stuck[2], stuck[0], atol=1e-4 * weight)


def test_a_step_leaves_what_it_starts_from_alone(wire):
    soft = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, yield_stress=60e6, hardening=0.1)
    floor = Plane((0, 0, 0.9), (0, 0, 1), 0.3)
    poses = [Pose((x, 0, 1.0), (0, 0, 0, 1)) for x in (0.0, -0.01, 0.02)]
    ends = [FarEnd(Pose((x, 0.1, 1.0), (0, 0, 0, 1)), 'sleeve') for x in (0.8, 0.75, 0.7)]
    for rod, obstacles, far in ((wire, [floor], [None] * 3), (soft, [], [None] * 3),
                                (wire, [], ends)):
        direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=obstacles)
        shape = direct.track(poses[:2], far_ends=far[:2])[1]
        before = deepcopy(pack(shape))
        one, two = (direct.solve(poses[2], shape, far_end=far[2]) for _ in range(2))
        np.testing.assert_array_equal(one.positions, two.positions)  # so it can be made again
        np.testing.assert_equal(pack(shape), before)


# ------------------------------------------------------------------------------------------------
# A DLO on a cylinder with flat ends: its side is a bar, its end a floor, its rim an edge.


WIRE = Rod(1.0, 0.1, 0.05, 0.04, radius=2e-3)
RAISED = Pose((0, 0, 1), (0, 0, 0, 1))


def solved(obstacle):
    shape = DirectSimulator(WIRE, n_elements=48, obstacles=[obstacle]).solve(RAISED)
    assert shape.converged and shape.stability > 0 and shape.contacts
    return shape


def outside(body, shape):
    """Return the least distance of the axis from the solid, sampled between the nodes too, m."""
    places = shape.positions_at(np.linspace(0, 1, 20_001))
    along = body.end - body.start
    axis = along / np.linalg.norm(along)
    height = (places - body.start) @ axis
    rho = np.linalg.norm(places - body.start - height[:, None] * axis, axis=1) - body.radius
    beyond = np.abs(height - 0.5 * np.linalg.norm(along)) - 0.5 * np.linalg.norm(along)
    inside = np.maximum(rho, beyond)
    return np.where(inside > 0, np.hypot(np.maximum(rho, 0), np.maximum(beyond, 0)), inside).min()


def test_on_its_side_it_is_a_bar():
    ends = (0.4, -0.5, 0.85), (0.4, 0.5, 0.85)
    round_, flat = solved(Capsule(*ends, 0.05)), solved(Cylinder(*ends, 0.05))
    assert np.abs(round_.positions - flat.positions).max() < 1e-9
    assert flat.contacts[0].force == pytest.approx(round_.contacts[0].force, rel=1e-7)


def test_an_ellipsoid_that_is_round_in_the_plane_of_the_dlo_is_a_bar():
    bar = solved(Capsule((0.4, -0.5, 0.85), (0.4, 0.5, 0.85), 0.05))
    egg = solved(Ellipsoid(Pose((0.4, 0, 0.85), (0, 0, 0, 1)), (0.05, 0.5, 0.05)))
    assert np.abs(bar.positions - egg.positions).max() < 1e-9
    assert egg.contacts[0].force == pytest.approx(bar.contacts[0].force, rel=1e-7)
    assert egg.stability < bar.stability  # it may roll off to the side


def test_nothing_enters_an_ellipsoid():
    body = Ellipsoid(Pose((0.4, 0.01, 0.4), (0.1, 0.2, 0.3, 0.9)), (0.1, 0.08, 0.12), 0.5)
    places = solved(body).positions_at(np.linspace(0, 1, 20_001))
    local = (places - body.pose.position) @ body.pose.rotation
    surface = body.half_axes + WIRE.radius
    assert ((local / surface) ** 2).sum(axis=1).min() > 1 - 2e-2


def test_on_its_end_it_is_a_floor():
    floor, end = solved(Plane((0, 0, 0.8), (0, 0, 1))), solved(
        Cylinder((0.5, 0, 0), (0.5, 0, 0.8), 3.0))
    assert np.abs(floor.positions - end.positions).max() < 1e-9
    assert sum(one.force for one in end.contacts) == pytest.approx(
        sum(one.force for one in floor.contacts), rel=1e-6)


def test_at_its_rim_it_is_an_edge():
    body = Cylinder((0.45, 0, 0.2), (0.45, 0, 0.85), 0.05)  # upright: the rim is nearest
    shape = solved(body)
    assert outside(body, shape) == pytest.approx(WIRE.radius, abs=1e-6)
    for contact in shape.contacts:
        assert np.hypot(contact.position[0] - 0.45, contact.position[1]) <= 0.05 + 2e-3 + 1e-9
    total = sum(contact.force * contact.normal for contact in shape.contacts)
    weight = WIRE.mass_per_length * 9.81
    assert shape.gripper_wrench[:3] + total == pytest.approx([0, 0, weight], abs=1e-6 * weight)


def test_nothing_gets_through_it():
    body = Cylinder((0.45, -0.02, 0.3), (0.45, 0.02, 0.3), 0.2)
    simulator = DirectSimulator(WIRE, n_elements=48, obstacles=[body])
    down = [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(1, 0.55, 10)]
    for shape in simulator.track(down):
        assert shape.converged and outside(body, shape) > WIRE.radius - 1e-6


# ------------------------------------------------------------------------------------------------
# A rigid body at the tip: weight, inertia, and that it does not bend.


HERE = Pose.identity()
LENGTH, MASS = 0.03, 0.02


@pytest.fixture
def cable():
    return Rod.circular(1.0, 2e-3, 1200.0, 5e6, 0.4, tip_mass=0.001)


@pytest.mark.parametrize('options', [{}, {'basis': 'local', 'n_elements': 60}, {'accuracy': 1e-5}])
def test_it_is_the_weight_and_moment_of_its_mass(cable, options):
    plugged = DirectSimulator(with_plug(cable, LENGTH, MASS, center=0.01), **options).solve(HERE)
    assert plugged.converged
    # the same cable without it, and at its tip the weight on a rigid arm
    turn = plugged.at(1.0).rotation
    arm = 0.01 * turn[:, 0]
    weight = np.array([0.0, 0.0, -9.81 * MASS])
    loads = [PointLoad(weight, np.cross(arm, weight))]
    bare = DirectSimulator(cable, accuracy=1e-6, point_loads=loads).solve(HERE)
    off = np.linalg.norm(plugged.at(1.0).position - bare.positions[-1])
    assert off < 2 * plugged.error_estimate + 1e-6
    straight = plugged.at(1.0).position + LENGTH * turn[:, 0]
    np.testing.assert_allclose(plugged.positions[-1], straight, atol=1e-6)


@pytest.mark.every(3)
@pytest.mark.parametrize(('inertia', 'expected'), [(None, MASS * (3 * 1e-6 + LENGTH**2) / 12),
                                                   (2e-6, 2e-6), (0.0, 0.0)])
def test_mass_center_and_inertia_on_every_mesh(cable, inertia, expected):
    rod = with_plug(cable, LENGTH, MASS, inertia=inertia)
    for options in ({}, {'n_elements': 100}, {'basis': 'local', 'n_elements': 17}):
        s = DirectSimulator(rod, **options).solve(HERE).s
        own = node_masses(rod, s) - node_masses(with_plug(cable, LENGTH, 0.0), s)
        assert own.sum() == pytest.approx(MASS)
        assert own @ s / MASS == pytest.approx(1.015)
        assert own @ (s - 1.015) ** 2 == pytest.approx(expected, abs=1e-12)


def test_all_of_its_mass_may_be_at_its_two_ends(cable):
    for size in np.linspace(0.01, 0.1, 37):  # whatever their rounding
        rod = with_plug(cable, size, MASS, inertia=MASS * (0.5 * size) ** 2)
        assert [s for s, _ in rod.point_masses[1:]] == [1.0, 1.0 + size]


@pytest.mark.parametrize(('change', 'words'), [
    ({'length': 0.0}, 'length'), ({'mass': -1.0}, 'mass'), ({'radius': 0.0}, 'radius'),
    ({'center': 0.04}, 'center'), ({'inertia': 5e-6}, 'inertia = 5e-06: .* <= 4.5e-06')])
def test_what_is_wrong_is_named(cable, change, words):
    with pytest.raises(InvalidRod, match=words):
        with_plug(cable, **{'length': LENGTH, 'mass': MASS} | change)
