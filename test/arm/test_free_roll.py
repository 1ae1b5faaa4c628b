# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a roll of the gripper changes nothing, and where it does: asked of the direct simulator."""

from dataclasses import replace

import numpy as np
import pytest
from misuse import MALFORMED, outcome
from scipy.spatial.transform import Rotation
from specimens import LEVEL, values

from dlo_planner import DirectSimulator, PointLoad, Pose, Rod
from dlo_planner.arm import rolls_freely

ROUND = Rod(1.0, 0.1, 1.0, 0.7)
RODS = {
    'round': (ROUND, True),
    'round, of a section': (Rod.circular(1.0, 0.004, 1000.0, 1e10, 0.3), True),
    'a strip': (Rod(1.0, 0.1, (1.0, 2.0), 0.7), False),
    'square': (Rod.rectangular(1.0, 0.01, 0.01, 1000.0, 1e9, 0.3), False),  # touches by corners
    'bent': (Rod(1.0, 0.1, 1.0, 0.7, natural_curvature=(0.0, 0.5)), False),
    'twisted': (Rod(1.0, 0.1, 1.0, 0.7, natural_twist=0.5), False),
    'a strip in a part': (Rod(1.0, 0.1, (1.0, ((0.0, 1.0), (0.8, 1.0), (1.0, 3.0))), 0.7), False),
    'one that yields': (Rod(1.0, 0.1, 1.0, 0.7, yield_curvature=0.5), False),
}


@pytest.mark.parametrize('name', RODS)
def test_whether_a_roll_is_free(name):
    rod, free = RODS[name]
    assert rolls_freely(DirectSimulator(rod), values()['Plan']) is free


@pytest.mark.parametrize('name', ['round', 'a strip', 'bent'])
def test_the_simulator_agrees(name):
    rod, free = RODS[name]
    simulator = DirectSimulator(rod, n_elements=16, n_terms=6,
                                point_loads=[PointLoad((0.0, 0.3, 0.0))])
    turn = Rotation.from_rotvec([0.7, 0.0, 0.0]).as_matrix()
    rolled = LEVEL.compose(Pose.from_rotation((0, 0, 0), turn))
    off = np.abs(simulator.solve(rolled).positions - simulator.solve(LEVEL).positions).max()
    assert bool(off < 1e-6) is free


def test_a_held_far_end_keeps_the_roll():
    simulator = DirectSimulator(ROUND, n_elements=8, n_terms=4)
    held = simulator.solve(LEVEL, far_end=(0.8, 0.0, 1.0))
    plan = values()['Plan']
    assert not rolls_freely(simulator, replace(plan, shapes=(held,) * len(plan)))


@pytest.mark.parametrize('argument', ['simulator', 'plan'])
def test_malformed_arguments_are_refused_by_name(argument):
    good = {'simulator': DirectSimulator(ROUND), 'plan': values()['Plan']}
    wrong = {label: outcome(rolls_freely, {**good, argument: make()}, argument)
             for label, make in MALFORMED.items()}
    assert not {label: what for label, what in wrong.items() if what}
