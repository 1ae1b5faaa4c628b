# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO comes to rest among obstacles from afar: laid down, set upright, slipping, falling."""

import numpy as np
import pytest

from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    FarEnd,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.energy.potential import configuration_at
from dlo_planner.minimize.semismooth import loaded_by_contacts
from dlo_planner.rods import with_plug

G = 9.81
CABLE = Rod(1.0, 0.045, (1e-2, 1e-2), 8e-3, radius=3e-3)
HOSE = Rod(1.0, 0.05, (5e-4, 5e-4), 4e-4, radius=3e-3)
DOWN = (0.3, 0.0, -1.0)


def check_laws(rod, shape, friction):
    """Forces balance the weight, and keep Coulomb's law."""
    force = shape.gripper_wrench[:3] + sum((one.vector for one in shape.contacts), np.zeros(3))
    np.testing.assert_allclose(force, [0, 0, rod.mass_per_length * rod.length * G], atol=1e-6)
    for one in shape.contacts:
        assert one.force >= 0.0
        assert np.linalg.norm(one.friction) <= friction * one.force * (1 + 1e-6) + 1e-9
    assert shape.positions[:, 2].min() > rod.radius - 1e-6


@pytest.mark.parametrize('height', [0.79, 0.65, 0.51])
def test_a_limp_wire_is_set_down_with_its_end_in_the_air(height):
    # without the floor it falls far: it meets the floor before it has come anywhere near to rest
    limp = Rod(1.556, 0.05, (3.6e-3, 3.6e-3), 2.8e-3, radius=4.9e-3, natural_curvature=(0.29, 0))
    table = DirectSimulator(limp, basis='local', n_elements=32,
                            obstacles=[Plane((0, 0, 0), (0, 0, 1))])
    shape = table.solve(Pose((0, 0, height), (0, 0.149438, 0, 0.988771)))
    assert shape.converged and len(shape.contacts) > 5, shape.status
    check_laws(limp, shape, 0.0)


@pytest.mark.parametrize(('height', 'few'), [(0.258, 300), (0.231, 900)])
def test_a_limp_wire_with_a_plug_leans_on_a_bar(height, few):
    # it hardly resists being moved along the bar, and its plug lies flat on the floor
    wire = with_plug(Rod(0.4563, 0.05, (2.855e-4, 2.855e-4), 2.2e-4, radius=1.25e-3), 0.0805,
                     0.0137, radius=2.5e-3)
    bar = Capsule((0.2059, -0.174, -0.1573), (0.2059, 0.1481, 0.1648), 9.6e-3)
    direct = DirectSimulator(wire, n_elements=64, n_terms=12,
                             obstacles=[bar, Plane((0, 0, -0.161), (0, 0, 1))])
    shape = direct.solve(Pose((0, 0, height), (0, 0.389418, 0, 0.921061)))
    assert shape.converged and shape.violation < 1e-8, shape.status
    assert shape.iterations < few


def test_a_shape_that_a_coarser_mesh_leads_astray_is_sought_anew():
    hose = Rod(1.387, 0.05, (0.482, 0.482), 0.371, radius=8.23e-3)
    table = DirectSimulator(hose, obstacles=[Plane((0, 0, 0), (0, 0, 1))])
    shape = table.solve(Pose((0, 0, 0.0410581), (0, 0.564642, 0, 0.825336)))
    assert shape.converged, shape.status
    check_laws(hose, shape, 0.0)


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_a_cable_that_hangs_down_is_set_on_a_table(friction):
    table = DirectSimulator(CABLE, n_elements=64, obstacles=[Plane((0, 0, 0), (0, 0, 1), friction)])
    shape = None
    for height in np.arange(1.05, 0.64, -0.02):
        shape = table.solve(Pose.looking_along((0, 0, height), DOWN), shape)
        assert shape.converged, shape.status
        check_laws(CABLE, shape, friction)
    assert shape.contacts


def test_a_soft_hose_is_laid_on_a_rough_table():
    table = DirectSimulator(HOSE, n_elements=64, obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    shape = None
    for height in (0.40, 0.38, 0.36, 0.34):
        shape = table.solve(Pose.looking_along((0, 0, height), (1, 0, 0)), shape)
        assert shape.converged and shape.residual < 1e-7, shape.status
        check_laws(HOSE, shape, 0.3)


def test_a_cable_falls_off_a_ball_and_comes_to_rest():
    ball = Sphere((0.5, 0.004, -0.25), 0.1, 0.2)
    direct = DirectSimulator(CABLE, n_elements=64, obstacles=[ball])
    shape = direct.solve(Pose.looking_along((0, 0, 0), (1, 0, 0)))
    assert shape.converged, shape.status


@pytest.mark.parametrize('friction', [0.0, 0.3])
@pytest.mark.parametrize('height', [0.98, 0.7])
def test_a_cable_straight_down_to_a_table_does_not_stand_on_its_tip(height, friction):
    """Straight is no stable shape: it bows to one of all sides, which are alike."""
    table = DirectSimulator(CABLE, n_elements=64, obstacles=[Plane((0, 0, 0), (0, 0, 1), friction)])
    shape = table.solve(Pose.looking_along((0, 0, height), (0, 0, -1)))
    assert shape.converged and abs(shape.stability) < 1e-8, shape.status
    assert np.hypot(*shape.positions[-1, :2]) > 0.5 * np.sqrt(1 - height**2)
    check_laws(CABLE, shape, friction)


def test_limp_contacts_are_found_exactly():
    """Stiff springs would multiply rounding errors: residuals of 1e-6, forces of 1e-4."""
    length = 0.52653
    rod = Rod(length, 0.05, lambda s: 1.3e-4 + 3.9e-4 * s / length,
              lambda s: 1e-4 + 3e-4 * s / length, radius=1.1e-3)
    table = DirectSimulator(rod, basis='local', n_elements=64,
                            obstacles=[Plane((0, 0, 0), (0, 0, 1), 1.5)])
    shape = None
    for height in 0.2595 - 0.005265 * np.arange(6):
        shape = table.solve(Pose((0, 0, height), (0, 0, 0, 1)), shape)
        assert shape.converged and shape.residual < 1e-7, shape.status
        check_laws(rod, shape, 1.5)


def test_a_gripper_comes_a_long_way_nearer_to_a_held_end():
    """What is between the grips turns more than a step may, so that it is made in parts."""
    rod = Rod(1.375, 0.05, (5.74e-3, 5.74e-3), 4.42e-3, radius=2.5e-3)
    bar = Capsule((0.443, -1.4, 0), (0.443, 1.4, 0), 0.102, friction=0.1)
    direct, shape = DirectSimulator(rod, basis='local', n_elements=64, obstacles=[bar]), None
    for x, z in ((0, 0.7), (0, 0.5), (0, 0.3), (0, 0.1), (0.11, 0.1)):
        end = FarEnd(Pose((0.8866, 0, z), (0, 0, 0, 1)), 'pinned')
        shape = direct.solve(Pose((x, 0, z), (0, 0, 0, 1)), shape, far_end=end)
        assert shape.converged, shape.status
    assert shape.contacts and shape.violation < 1e-9
    np.testing.assert_allclose(shape.positions[-1], (0.8866, 0, 0.1), atol=1e-9)


def test_where_a_point_bears_does_not_depend_on_the_way_there():
    """Both nodes and the middle of an element may carry what one point does that rolls."""
    rod = Rod(1.0, 0.05, (0.2937, 0.2643), 0.0881, radius=1e-3, natural_curvature=(0.2279, -0.4946))
    bar = Capsule((0.4602, -0.5526, -2.021), (0.4602, 0.4474, -2.021), 1.954)
    direct = DirectSimulator(rod, basis='local', n_elements=64, obstacles=[bar])
    here = Pose((0, 0, 0), (0, 0, 0, 1))
    near = [Pose((0, 0, height), (0, 0, 0, 1)) for height in (0.02, 0.01, 0.005)]
    from_afar, carried = direct.solve(here), direct.track([*near, here])[-1]
    assert len(from_afar.contacts) == len(carried.contacts) == 1
    np.testing.assert_allclose(from_afar.positions, carried.positions, atol=1e-9)


@pytest.mark.parametrize(('bend', 'twist', 'natural'), [
    ((0.25557666, 0.25557666), 0.49129959, (0.81283134, -0.53953288)),
    ((0.15671587, 0.12057076), 0.11655946, (-0.45440502, -0.22023870))])
def test_what_begins_in_a_sheet_beside_its_hole_comes_out(bend, twist, natural):
    rod = Rod(1.0, 0.05, bend, twist, radius=0.01, natural_curvature=natural)
    hole = CutOut(Pose((0.5, 0, -0.15), (0, 0, 0, 1)), radius=0.03)
    direct = DirectSimulator(rod, basis='local', n_elements=32,
                             obstacles=[Sheet.around(hole, 0.3, 0.3)])
    shape = direct.solve(Pose((0, 0, -0.15), (0, 0, 0, 1)))
    assert shape.converged and shape.violation < 1e-9, shape.status
    fine = shape.positions_at(np.linspace(0, 1, 1001)) - hole.pose.position
    beside = np.maximum(hole.radius - np.hypot(fine[:, 1], fine[:, 2]), 0.0)  # 0: over the sheet
    above = np.maximum(np.abs(fine[:, 0]) - 0.5 * direct.obstacles[0].thickness, 0.0)
    within = np.abs(fine[:, 1:]).max(axis=1) < 0.15
    assert np.hypot(beside, above)[within].min() > rod.radius - 1e-6


@pytest.mark.parametrize('grip', ['pinned', 'clamped'])
@pytest.mark.parametrize('nearer', [0.005, 0.02, 0.08])
def test_a_dlo_comes_to_touch_as_its_held_end_comes_nearer(nearer, grip):
    """A step that closes all of the way of the end at once would go deep into the floor."""
    rod = Rod(1.0, 0.05, (0.02, 0.02), 0.016, radius=2e-3)
    ends = [FarEnd(Pose((span, 0, 0), (0, 0, 0, 1)), grip) for span in (0.8, 0.8 - nearer)]
    free, here = DirectSimulator(rod, basis='local', n_elements=48), Pose((0, 0, 0), (0, 0, 0, 1))
    low = free.solve(here, far_end=ends[0]).positions[:, 2].min() - rod.radius - 1e-3
    direct = DirectSimulator(rod, basis='local', n_elements=48,
                             obstacles=[Plane((0, 0, low), (0, 0, 1))])
    first = direct.solve(here, far_end=ends[0])
    shape = direct.solve(here, first, far_end=ends[1])
    assert shape.converged and shape.violation < 1e-9, shape.status
    assert shape.contacts and shape.positions[:, 2].min() > low + rod.radius - 1e-9


def test_many_nodes_of_a_series_lie_on_a_floor():
    """More nodes come near than terms can press on it: the flow tells which bear."""
    rod = Rod(1.0, 0.1, (0.05, 0.05), 0.04, radius=2e-3)
    direct, shape = DirectSimulator(rod, basis='chebyshev', n_elements=100, n_terms=20,
                                    obstacles=[Plane((0, 0, 0), (0, 0, 1))]), None
    for height in (0.05, 0.02, 0.006):
        shape = direct.solve(Pose((0, 0, height), (0, 0, 0, 1)), shape)
        assert shape.converged, shape.status
    assert shape.positions[:, 2].min() > rod.radius - 1e-9


def test_a_cut_out_that_is_narrower_than_an_element_is_not_entered_beside_it():
    """The gap to its rim falls and rises twice in an element."""
    rod = Rod(0.306, 0.05, (4.45e-3, 4.45e-3), 3.43e-3, radius=6.3e-4)
    hole = CutOut(Pose((0.31270961, 0, -0.02253297), (-0.266884, -0.138123, -0.219448, 0.92819)),
                  radius=3.27e-3)
    direct = DirectSimulator(rod, basis='local', n_elements=32,
                             obstacles=[Sheet.around(hole, 0.46, 0.46, 0.0)])
    ways = np.array([(0.03215, -0.000286, 0.08622), (0.04027, -0.000286, 0.08194)])
    for place in ways:
        shape = direct.solve(Pose(place, (0, 0, 0, 1)))
        fine = (shape.positions_at(np.linspace(0, rod.length, 3001)) - hole.pose.position
                ) @ hole.pose.rotation
        rim = np.hypot(fine[:, 0], np.maximum(hole.radius - np.hypot(fine[:, 1], fine[:, 2]), 0.0))
        assert shape.converged and shape.contacts
        assert rim.min() > rod.radius - 1e-6


def test_on_a_fine_mesh_not_every_node_near_an_obstacle_is_a_candidate():
    # the work goes with the square of their number; what is pressed in counts in any case
    floor = [Plane((0, 0, 0), (0, 0, 1))]
    mesh = DirectSimulator(CABLE, basis='local', n_elements=1000, obstacles=floor).mesh_after(None)
    for height, least, most in ((3.5e-3, 300, 510), (2.9e-3, 1000, 1000)):
        system = mesh.system(np.eye(3), np.array([0.0, 0.0, height]))
        state = configuration_at(system, np.zeros((1000, 3)))
        loaded = loaded_by_contacts(system, state, np.zeros((0, 6)), 0.01, True, True)
        contacts = loaded.effects.contact.contacts
        pushes = contacts.node[0, 1:] > contacts.stiffness * (height - 3e-3)
        assert least <= np.count_nonzero(pushes) <= most
