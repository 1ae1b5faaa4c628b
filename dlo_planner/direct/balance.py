# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The energy balance of a step: what its grips gave, and what the DLO took, stored and lost."""

from __future__ import annotations

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.geometry.so3 import matrix, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

# What a step may seem to lose beyond what it was given. Of the elastic energy: two meshes differ
# by about as much. Times the work: on the way the force may be larger than at both its ends, as
# where a DLO buckles. In 80 random scenes of wires that yield on mandrels, in two grips or
# under loads no step of a shape that was found is refused.
_ROUGH, _MORE_WORK = 0.05, 2.0


def work_of_grips(previous: Shape, shape: Shape) -> tuple[float, float]:
    """Return the work in J of both grips in a step from `previous`, and its spread (`_work`).

    A far end that is let go does no work.
    """
    one, other = previous.gripper, shape.gripper
    work, spread = _work(one.rotation, other.rotation, one.position, other.position,
                         previous.gripper_wrench, shape.gripper_wrench)
    if shape.far_end is not None:
        more, wider = _work(previous.frames[-1], shape.frames[-1], previous.positions[-1],
                            shape.positions[-1], previous.far_wrench, shape.far_wrench)
        work, spread = work + more, spread + wider
    return work, spread


def overspent(previous: Shape, shape: Shape) -> float:
    """Return by how much, in J, plastic deformation takes more in a step than it was given; else 0.

    It was given the work of the grips, and the energy that is not there any more.
    """
    lost = shape.dissipated - previous.dissipated
    work, spread = work_of_grips(previous, shape)
    given = previous.energy - shape.energy + max(work, 0.0) * _MORE_WORK + min(work, 0.0)
    energy = max(previous.elastic_energy, shape.elastic_energy)
    return max(0.0, lost - given - _MORE_WORK * spread - _ROUGH * energy)


@kernel
def _work(one: Floats, other: Floats, begin: Floats, end: Floats, before: Floats,
          after: Floats) -> tuple[float, float]:
    """Return the work in J of a grip on a straight way, its force changing evenly; and its spread.

    It is larger or smaller by up to the spread if all of the change is at one end of the way.
    Rotations, positions and wrenches on the DLO are those at both ends.
    """
    turn = rotation_vector(times_transposed(matrix(other), matrix(one)))
    work = spread = 0.0
    for i in range(3):
        shift = end[i] - begin[i]
        work += (before[i] + after[i]) * shift + (before[3 + i] + after[3 + i]) * turn[i]
        spread += abs((after[i] - before[i]) * shift)
        spread += abs((after[3 + i] - before[3 + i]) * turn[i])
    return 0.5 * work, 0.5 * spread
