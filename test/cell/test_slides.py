# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Slides over a bar whose friction the planner does not know, in the cell's engine."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from dlo_planner import (  # noqa: E402  mujoco may be missing
    Capsule,
    DirectSimulator,
    InverseSimulator,
    Pose,
    Rod,
    Trajectory,
)
from dlo_planner.cell.plant import Plant  # noqa: E402

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))
BAR = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
TOP = Pose((0.5, 0.0, 0.72), (0.0, 0.0, 0.0, 1.0))
PERIOD = 0.01  # s
LOWERED = 0.2  # m, onto the bar


def part_lost(plan, friction):
    """Return the part of the time of a calm slide in which the engine's wire is off the bar."""
    way, begin = Trajectory(plan), plan.grippers[0]
    plant = Plant(WIRE, Pose(begin.position + (0, 0, LOWERED), begin.quaternion),
                  [replace(BAR, friction=friction)], cells=24, damping=0.05)
    for part in np.linspace(1, 0, 200)[1:]:
        plant.move(Pose(begin.position + (0, 0, part * LOWERED), begin.quaternion), PERIOD)
    for _ in range(200):
        plant.move(begin, PERIOD)
    assert plant.forces[0] == pytest.approx(plan.shapes[0].contacts[0].force, rel=0.3)
    touches = []
    for gripper in way.at(np.arange(PERIOD, way.duration, PERIOD))[0]:
        plant.move(gripper, PERIOD)
        touches.append(plant.forces[0] > 0)
    return 1 - np.mean(touches)


@pytest.mark.sweep
def test_the_least_force_of_a_plan_keeps_the_contact_where_there_is_friction():
    inverse = InverseSimulator(DirectSimulator(WIRE, basis='local', n_elements=24,
                                               obstacles=[BAR]))
    lengths = [0.7, 0.65, 0.6]
    pressed = inverse.slide_contact(TOP, lengths, condition='least_force')
    assert part_lost(pressed, 0.3) == 0
    light = inverse.slide_contact(TOP, lengths, forces=[0.005], min_force=0.0)
    assert part_lost(light, 0.3) > 0.1
