# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""An overhand knot in a wire, as the benchmark of strands ties it."""

import numpy as np
import pytest

from benchmarks.strands import knotted
from dlo_planner import DirectSimulator, FarEnd, Pose, Rod

WIRE = Rod(length=0.6, mass_per_length=0.035, bending_stiffness=1.2e-3,
           torsional_stiffness=0.96e-3, radius=2.5e-3)


def test_a_knot_is_drawn_out_by_the_pull_that_its_energy_says():
    shape = knotted(WIRE, 64)
    assert shape.converged
    assert len(shape.self_contacts) >= 3
    simulator = DirectSimulator(WIRE, basis='local', n_elements=64, gravity=(0, 0, 0),
                                self_contact=True)
    end = shape.far_end.pose
    line = end.position - shape.positions[0]
    line, shapes = line / np.linalg.norm(line), []
    for way in (1e-4, 2e-4, 3e-4):
        shape = simulator.solve(shape.gripper, shape, far_end=FarEnd(Pose.from_rotation(
            end.position + way * line, end.rotation)))
        assert shape.converged
        assert shape.passed_itself is False
        shapes.append(shape)
    pull = (shapes[2].energy - shapes[0].energy) / 2e-4
    assert shapes[1].far_wrench[:3] @ line == pytest.approx(pull, rel=0.01)
