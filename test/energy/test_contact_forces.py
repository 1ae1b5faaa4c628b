# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces of contact and friction in closed form, on a straight DLO."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Plane, Rod, Sphere
from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.gap import closest_point_in_element
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.minimize.hessian import assemble, multiply, new_hessian

RADIUS, HEIGHT, STIFF, GRIP = 0.01, 0.3, 50.0, 20.0
ROD = Rod(1.0, 0.0, 1.0, 0.7, radius=RADIUS)
FLOOR = Plane((0, 0, 0), (0, 0, 1))
NODES = 5


def straight(node=(0, 0, 0, 0, 0), element=(), obstacle=(), multiplier=(), fraction=(), anchor=(),
             obstacles=(FLOOR,), height=HEIGHT):
    """Return the Problem of a level straight DLO of 4 elements above obstacles, with contacts."""
    c = len(element)
    contacts = ContactSet(STIFF, np.tile(np.array(node, dtype=float), (len(obstacles), 1)),
                          np.array(element, dtype=np.int64), np.array(obstacle, dtype=np.int64),
                          np.array(multiplier, dtype=float), np.array(fraction, dtype=float),
                          np.array(anchor, dtype=float).reshape(c, 3),
                          np.tile([0.0, 0.0, 1.0], (c, 1)), np.zeros((c, 3)), GRIP)
    direct = DirectSimulator(ROD, basis='local', n_elements=4, gravity=(0, 0, 0),
                             obstacles=obstacles)
    system = direct.mesh.system(np.eye(3), (0, 0, height))
    return system._replace(contacts=contacts)


def at_rest(system):
    state = new_configuration(system)
    return evaluate(system, state)[0], state


def test_a_node_is_pushed_by_its_multiplier_less_the_gap():
    gap = HEIGHT - RADIUS
    forces = np.array([0, 3.0, 30.0, STIFF * gap, 20.0])
    energy, state = at_rest(straight(forces))
    pushed = np.maximum(forces - STIFF * gap, 0)
    pushed[0] = 0  # the gripper's node is the gripper's
    np.testing.assert_allclose(state.pull, -pushed[:, None] * [0, 0, 1], atol=1e-12)
    assert pushed[2] > 0 and pushed[4] > 0
    assert energy == pytest.approx(np.sum(pushed**2 - forces**2) / (2 * STIFF))


@pytest.mark.parametrize('begun', [0, 1, 2, 3])
def test_a_point_is_pushed_likewise_wherever_it_rolls_to(begun):
    ball = Sphere((0.55, 0, 0), 0.1)
    system = straight(element=[begun], obstacle=[0], multiplier=[12.0], fraction=[0],
                      anchor=np.zeros((1, 3)), obstacles=[ball])
    energy, state = at_rest(system)
    gap = HEIGHT - 0.1 - RADIUS  # of the point above the ball, 0.2 of element 2
    assert state.attached.element[0] == 2
    assert state.attached.fraction[0] == pytest.approx(0.2)
    pushed = 12.0 - STIFF * gap
    assert pushed > 0
    np.testing.assert_allclose(state.attached.force, [[0, 0, -pushed]], atol=1e-12)
    assert energy == pytest.approx((pushed**2 - 12.0**2) / (2 * STIFF))


@pytest.mark.sweep
def test_forces_of_points_that_have_rolled_past_each_other_are_the_potentials_slope():
    # listed in elements 0 and 3, at last in 2 and 0; a point of friction stays in element 1
    balls = [Sphere((0.55, 0, 0), 0.1), Sphere((0.1, 0, 0), 0.1)]
    system = straight(element=[0, 1, 3], obstacle=[0, -1, 1], multiplier=[12.0, 0.4, 15.0],
                      fraction=[0, 0.3, 0], anchor=[[0, 0, 0], [0.3, 0.1, 0.6], [0, 0, 0]],
                      obstacles=balls)
    state = new_configuration(system)
    q = np.random.default_rng(0).normal(size=(4, 3)) * 1e-2
    state.q[:] = q
    evaluate(system, state)
    assert state.attached.element.tolist() == [2, 1, 0]
    assert state.attached.order.tolist() == [2, 1, 0]
    assert (np.linalg.norm(state.attached.force, axis=1) > 0).all()
    gradient, hessian = state.gradient.copy(), new_hessian(system)
    assemble(system, state, hessian)
    direction = np.random.default_rng(1).normal(size=(4, 3))
    product, step = np.empty((4, 3)), 1e-6
    multiply(system, hessian, direction, product)
    slopes, energies = [], []
    for sign in (1, -1):
        state.q[:] = q + sign * step * direction
        energies.append(evaluate(system, state)[0])
        slopes.append(state.gradient.copy())
    assert np.sum(gradient * direction) == pytest.approx(
        (energies[0] - energies[1]) / (2 * step), rel=1e-6)
    np.testing.assert_allclose(product, (slopes[0] - slopes[1]) / (2 * step),
                               atol=1e-5 * np.abs(product).max())


def test_friction_sticks_up_to_its_limit_and_then_pulls_evenly():
    # the points' anchors are pulled aside by more and more; out of the plane does not count
    away = np.array([0.0, 0.02, 0.0499, 0.05, 0.0501, 0.2])
    limit, x = 1.0, 0.125
    energies, forces = [], []
    for off in away:
        anchor = [[x, -off, 0.7]]
        energy, state = at_rest(straight(element=[0], obstacle=[-1], multiplier=[limit],
                                         fraction=[0.5], anchor=anchor))
        energies.append(energy)
        forces.append(state.attached.force[0].copy())
    pulls = np.minimum(GRIP * away, limit)
    np.testing.assert_allclose(forces, pulls[:, None] * [0, 1, 0], atol=1e-12)
    wanted = np.where(away * GRIP <= limit, 0.5 * GRIP * away**2,
                      limit * (away - 0.5 * limit / GRIP))
    np.testing.assert_allclose(energies, wanted, atol=1e-12)


def test_a_state_forgets_what_touched_before():
    pressed, free = straight([0, 30, 30, 0, 30]), straight()
    state, fresh = new_configuration(pressed), new_configuration(free)
    for _ in range(2):
        evaluate(pressed, state)
        once = state.attached.spring.copy()
    evaluate(pressed, state)
    np.testing.assert_array_equal(state.attached.spring, once)  # nothing adds up
    evaluate(free, state)
    evaluate(free, fresh)
    assert not state.attached.sprung.any()
    np.testing.assert_array_equal(state.pull, fresh.pull)


@pytest.mark.parametrize(('tilt', 'end'), [(0.4, 0.0), (-0.4, 1.0)])
def test_the_nearest_point_of_an_element_that_comes_down_is_its_end(tilt, end):
    system = straight()
    lengths, strains = system.lengths, np.zeros((4, 3))
    turn = Rotation.from_rotvec([0, -tilt, 0]).as_matrix()
    rotations = np.tile(turn, (NODES, 1, 1))
    positions = np.linspace(0, 1, NODES)[:, None] * turn[:, 0]
    gap, fraction = closest_point_in_element(system.scene, 0, 1, lengths, strains, rotations,
                                             positions, np.empty(3), np.empty((3, 3)))
    assert fraction == end
    assert gap == pytest.approx(HEIGHT + 0.25 * (1 + end) * np.sin(tilt) - RADIUS)


def test_the_nearest_point_of_a_sagging_arc_is_its_lowest():
    # a circle about the ball's own center line: bent downwards and up again
    system = straight()
    curvature, strains = 2.0, np.zeros((4, 3))
    strains[:, 1] = -curvature
    start = 0.2  # rad below the horizontal at the element's beginning
    turn = Rotation.from_rotvec([0, start, 0]).as_matrix()
    rotations, positions = np.tile(turn, (NODES, 1, 1)), np.zeros((NODES, 3))
    normal, bend = np.empty(3), np.empty((3, 3))
    gap, fraction = closest_point_in_element(system.scene, 0, 0, system.lengths, strains, rotations,
                                             positions, normal, bend)
    assert fraction == pytest.approx(start / curvature / 0.25, abs=1e-9)
    assert gap == pytest.approx(HEIGHT - (1 - np.cos(start)) / curvature - RADIUS, abs=1e-12)
