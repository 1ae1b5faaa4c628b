# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that goes on bearing where it does: carried along, few steps, the same shape."""

import numpy as np
import pytest

from dlo_planner import Box, Capsule, CutOut, DirectSimulator, Plane, Pose, Rod, Sheet
from dlo_planner.direct.equilibrium import corrected_by, past_of
from dlo_planner.minimize.semismooth import tangent_predictor

LEVEL = (0, 0, 0, 1)
ROUGH = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02, friction=0.3)
BAR = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
EDGE = Box(Pose((0.4, 0, 0.65), (0, np.sin(np.pi / 8), 0, np.cos(np.pi / 8))), (0.3, 0.2, 0.2))
HOLE = Sheet.around(CutOut(Pose.looking_along((0.4, 0, 1.0), (1, 0, 0)), radius=0.02))
SCENES = {'bar': (BAR, 0.8), 'edge': (EDGE, 0.85), 'hole': (HOLE, 0.97)}


def at(height):
    return Pose((0, 0, height), LEVEL)


@pytest.fixture(params=SCENES)
def bearing(request):
    """Return a simulator and a Shape that bears on its obstacle, without friction."""
    obstacle, height = SCENES[request.param]
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    simulator = DirectSimulator(wire, basis='local', n_elements=64, obstacles=[obstacle])
    shape = simulator.track([at(z) for z in np.arange(1.0, height - 1e-9, -0.01)])[-1]
    assert shape.converged and shape.contacts
    return simulator, shape


def test_a_step_takes_few_iterations_and_ends_where_small_ones_end(bearing):
    simulator, shape = bearing
    height = shape.gripper.position[2]
    whole = simulator.solve(at(height - 0.01), shape)
    parts = simulator.track([at(height - part) for part in np.linspace(0, 0.01, 8)],
                            initial=shape)[-1]
    assert whole.converged and not whole.jumped
    assert whole.iterations <= 6  # 11 to 26 where springs have to find the contact anew
    np.testing.assert_allclose(whole.positions, parts.positions, atol=1e-9)
    assert sum(c.force for c in whole.contacts) == pytest.approx(
        sum(c.force for c in parts.contacts), rel=1e-6)


def test_what_touches_in_a_step_is_found_at_once():
    # a candidate at a time would take as many steps as nodes touch, three or four
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    simulator = DirectSimulator(wire, n_elements=64, basis='local',
                                obstacles=[Plane((0, 0, 0), (0, 0, 1))])
    shapes = simulator.track([at(z) for z in np.append(np.arange(0.3, 0.1, -0.01),
                                                       0.1 - 1e-3 * np.arange(6))])
    bear = [tuple(c.s for c in shape.contacts) for shape in shapes[-6:]]
    assert len(set(bear)) > 3
    assert max(shape.iterations for shape in shapes[-5:]) <= 2


def test_what_is_carried_along_is_the_derivative_of_the_shape(bearing):
    simulator, shape = bearing
    position, mesh = shape.gripper.position, simulator.mesh
    past = past_of(mesh, shape, None)
    slid = np.zeros_like(past.points.slid)
    errors = []
    for step in (2e-3, 1e-3):
        twist = np.array([0, 0.5, 0, 1, 0, -1]) * step
        gripper = Pose(position + twist[3:], (0, np.sin(twist[1] / 2), 0, np.cos(twist[1] / 2)))
        system = mesh.system(gripper.rotation, gripper.position, past)
        follows, q, _ = tangent_predictor(system, np.array(shape.gripper.rotation), slid,
                             np.array(shape.element_strains), twist)
        true = simulator.solve(gripper, shape)
        assert follows and true.converged
        errors.append(np.abs(mesh.strains_of(q) - true.element_strains).max()
                      / np.abs(true.element_strains - shape.element_strains).max())
    assert errors[0] < 0.2
    assert errors[1] < 0.6 * errors[0]  # what is left of the change is of second order


def test_the_first_correction_on_a_finer_mesh_is_the_error_estimate(bearing):
    simulator, shape = bearing
    miss = corrected_by(simulator.mesh, shape, past_of(simulator.mesh, shape, None))
    assert miss == pytest.approx(shape.error_estimate, rel=0.02)


@pytest.mark.parametrize('bearing', ['bar', 'edge'], indirect=True)
def test_a_dlo_that_comes_free_is_not_held_back(bearing):
    simulator, shape = bearing
    away = simulator.solve(Pose(shape.gripper.position + (0, 0, 0.3), LEVEL), shape)
    alone = simulator.without_obstacles().solve(away.gripper)
    assert away.converged and not away.contacts
    np.testing.assert_allclose(away.positions, alone.positions, atol=1e-9)


@pytest.mark.parametrize('options', [{}, {'basis': 'local', 'n_elements': 64}])
def test_a_row_of_nodes_on_a_table_takes_few_steps(options):
    # what pulls is let go, what is pressed in bears: else one node after the other, 17 steps
    rod = Rod(1.0, 0.05, 0.02, 0.015, radius=2e-3)
    direct = DirectSimulator(rod, obstacles=[Plane((0, 0, -0.1), (0, 0, 1))], **options)
    shape = direct.track([at(0.0), at(0.001)])[-1]
    for height in (0.0, 0.001, 0.003):
        shape = direct.solve(at(height), shape)
        assert shape.converged and shape.iterations <= 4
        assert len(shape.contacts) >= (3 if not options else 14)
        assert min(contact.force for contact in shape.contacts) > 0
        assert max(contact.penetration for contact in shape.contacts) < 2e-8
        held = shape.gripper_wrench[2] + sum(contact.force for contact in shape.contacts)
        assert held == pytest.approx(0.05 * 9.81, rel=1e-9)
        assert shape.positions[:, 2].min() > -0.098 - 1e-9


def moved(bar):
    """Return a bar in front of a gripper that is not at the origin."""
    away = (0.4, -0.2, 0)
    return Capsule(bar.start + away, bar.end + away, bar.radius, friction=bar.friction)
