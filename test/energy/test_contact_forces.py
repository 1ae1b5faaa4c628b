# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces of contact and friction in closed form, on a straight DLO."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Plane, Rod, Sphere
from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration

RADIUS, HEIGHT, STIFF, GRIP = 0.01, 0.3, 50.0, 20.0
ROD = Rod(1.0, 0.0, 1.0, 0.7, radius=RADIUS)
FLOOR = Plane((0, 0, 0), (0, 0, 1))


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
