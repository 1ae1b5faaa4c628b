# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The energy balance of a step: what its grips gave, and what the DLO took, stored and lost."""

from __future__ import annotations

from dataclasses import replace

from dlo_planner.direct.grips import frame_inside
from dlo_planner.direct.shape import NO_WRENCH, Shape
from dlo_planner.geometry.so3 import matrix, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import counterpart

# What a step may seem to lose beyond what it was given. Of the elastic energy: two meshes differ
# by about as much. Times the work: on the way the force may be larger than at both its ends, as
# where a DLO buckles. In 80 random scenes of wires that yield on mandrels, in two grips or
# under loads no step of a shape that was found is refused.
_ROUGH, _MORE_WORK = 0.05, 2.0


def overspent(previous: Shape, shape: Shape) -> float:
    """Return by how much, in J, plastic deformation takes more in a step than it was given; else 0.

    It was given the work of the grips, and the energy that is not there any more. Energies of
    another DLO, or of one under other forces, say nothing of that: then it is 0, as it is where
    the energy before is not known (nan).
    """
    if not _compare(previous, shape):
        return 0.0
    lost = shape.dissipated - previous.dissipated
    work, spread = work_of_grips(previous, shape)
    given = previous.energy - shape.energy + max(work, 0.0) * _MORE_WORK + min(work, 0.0)
    energy = max(previous.elastic_energy, shape.elastic_energy)
    excess = lost - given - _MORE_WORK * spread - _ROUGH * energy
    return excess if excess > 0.0 else 0.0


def _compare(previous: Shape, shape: Shape) -> bool:
    """Whether energies of two Shapes are of one potential, as far as their meshes are known.

    Obstacles are none of it: what touches does no work.
    """
    one, other = previous.state.mesh, shape.state.mesh
    if one is None or other is None or one.surroundings is other.surroundings:
        return True
    return replace(one.surroundings, obstacles=()) == replace(other.surroundings, obstacles=())


def work_of_grips(previous: Shape, shape: Shape) -> tuple[float, float]:
    """Return the work in J of the grips on a straight way, forces changing evenly, and its spread.

    It is larger or smaller by up to the spread if all of the change is at one end of the way.
    """
    one, other = previous.gripper, shape.gripper
    work, spread = _work(one.rotation, other.rotation, one.position, other.position,
                         previous.gripper_wrench, shape.gripper_wrench)
    for hold, after in zip(shape.holds, shape.wrenches, strict=True):
        before, place = NO_WRENCH, hold.s
        held = counterpart(hold, shape.holds, previous.holds)
        for known, wrench in zip(previous.holds, previous.wrenches, strict=True):
            if known is held:
                before, place = wrench, known.s  # of a ring another place was in it
        turned, turned_after, at, at_after = (
            previous.frames[-1], shape.frames[-1], previous.positions[-1], shape.positions[-1])
        if hold.s is not None:
            assert place is not None
            (turned, at), (turned_after, at_after) = (
                frame_inside(previous, place), frame_inside(shape, hold.s))
        more, wider = _work(turned, turned_after, at, at_after, before, after)
        work, spread = work + more, spread + wider
    return work, spread


@kernel
def _work(one: Floats, other: Floats, begin: Floats, end: Floats, before: Floats,
          after: Floats) -> tuple[float, float]:
    """Return the work of one grip in J and its spread, of arrays.

    Rotations, positions and wrenches on the DLO are those before and after the step. What does not
    hold after it has let go, which is no work.
    """
    turn = rotation_vector(times_transposed(matrix(other), matrix(one)))
    work = spread = 0.0
    for i in range(3):
        shift = end[i] - begin[i]
        work += (before[i] + after[i]) * shift + (before[3 + i] + after[3 + i]) * turn[i]
        spread += abs((after[i] - before[i]) * shift)
        spread += abs((after[3 + i] - before[3 + i]) * turn[i])
    return 0.5 * work, 0.5 * spread
