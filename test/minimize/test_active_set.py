# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which points inside elements are watched, and where the force of one goes that is not."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Plane, Pose, Rod
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import new_configuration
from dlo_planner.minimize.active_set import update_active_set
from dlo_planner.minimize.contact_table import with_contacts, with_contacts_of

N, FORCE = 16, 0.2


@pytest.mark.parametrize(('pressed_in', 'handed_over'), [(1e-7, FORCE), (-1e-7, 0.0)])
def test_the_force_of_a_point_that_rolled_to_the_tip_is_the_tips(pressed_in, handed_over):
    # a straight DLO, slanting: its tip is nearest to the floor, no point inside an element is
    rod = Rod(1.0, 0.1, 0.1, 0.01, radius=0.005)
    simulator = DirectSimulator(rod, n_elements=N, basis='local',
                                obstacles=[Plane((0, 0, -0.105), (0, 0, 1))])
    gripper = Pose.looking_along((0, 0, -pressed_in), (np.sqrt(0.99), 0, -0.1))
    system = simulator.mesh.system(gripper.rotation, gripper.position)
    nothing = np.zeros((1, 3))
    contacts = with_contacts_of(system.contacts, np.array([N - 1]), np.array([0]),
                                np.array([FORCE]), np.zeros(1), nothing, nothing, nothing)
    system = with_contacts(system, contacts, system.effects.contact.scene)
    state = new_configuration(system)
    unknowns_of(system, np.zeros((N, 3)), state.q)
    evaluate(system, state)
    watched, _ = update_active_set(system, state)
    assert watched.element.size == 0
    assert watched.node[0, N] == handed_over
