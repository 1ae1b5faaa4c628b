# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What hangs freely is found without what could act; one compiled sweep tells whether it does.

An obstacle that is not touched and a yield stress that is not reached add zeros to the equations.
So a step is made first on the mesh without them (`Discretization.free`), by the quick way of a DLO
that hangs freely. `energy.terms.may_act` then looks at the end of the step and at the straight way
to it. Where nothing acts there, that is the answer; else the step is made again with all that acts.
What a DLO remembers (contacts, friction, a set) has it made so at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.memory import ACTING
from dlo_planner.direct.shape import Shape, State, with_state
from dlo_planner.direct.step import past_of
from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.terms import may_act
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.value import freeze, same

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.memory import Memory
    from dlo_planner.direct.terms import Left
    from dlo_planner.energy.problem import Problem
    from dlo_planner.model.pose import Pose



class Acts(Exception):  # noqa: N818  (no error: caught where it is asked for)
    """Something acts on a DLO that was taken to hang freely."""


class Culled:
    """Steps of a DLO without what may act on it, on the meshes of a simulator.

    Parameters
    ----------
    mesh : Discretization
        The simulator's, with all that may act.
    initial : Shape or None
        Shape with which the steps begin.

    Attributes
    ----------
    begin : Shape or None
        The same, on a mesh without what may act.
    """

    def __init__(self, mesh: Discretization, initial: Shape | None) -> None:
        self._mesh, self._initial, self._known = mesh, initial, [mesh]
        self.begin = initial
        known = None if initial is None else initial.state.mesh
        if initial is not None and known is not None and same(known.surroundings,
                                                              mesh.surroundings):
            self._known.append(known)
            self.begin = _on(initial, known.free, _freed(initial, known.free))

    @classmethod
    def of(cls, mesh: Discretization, initial: Shape | None) -> Culled | None:
        """Return one; None where the DLO hangs freely anyway, never does so, or remembers."""
        if mesh.hangs or not mesh.free.hangs:
            return None
        if initial is not None and not remembers_nothing(initial):
            return None
        return cls(mesh, initial)

    def judged(self, before: Shape | None, gripper: Pose, shape: Shape) -> None:
        """Raise Acts if something acts on a Shape, or between it and the one `before`, or None."""
        mesh = self._whole(shape)
        if acts_between(mesh, shape, _before(mesh.free, before, gripper)):
            raise Acts

    def with_all(self, shape: Shape) -> Shape:
        """Return a Shape on which nothing acts as one of the DLO with all that may act."""
        mesh = self._whole(shape)
        before = past_of(mesh, self._initial, None)
        left: Left = {}
        if shape.far_end is not None or before.left is not mesh.start.left:
            left = _left(mesh, shape.state.left.left)
        after = before.followed(shape.positions, shape.frames[:, :, 0].copy(), **left)
        return _on(shape, mesh, (after, before))

    def _whole(self, shape: Shape) -> Discretization:
        """Return the Discretization, with all that may act, of a Shape without."""
        free = shape.state.made_on
        for mesh in self._known:
            if mesh.free is free:
                return mesh
        mesh = self._mesh.on(free)
        self._known.append(mesh)
        return mesh


def remembers_nothing(shape: Shape) -> bool:
    """Return whether a Shape touches nothing and has no past that acts on the next step."""
    known, mesh = shape.state.history, shape.state.mesh
    if known is None or mesh is not None and known.left is mesh.start.left:  # most of them
        return not shape.contacts
    return not shape.contacts and all(part.idle(known.left) for part in ACTING)


def acts_between(mesh: Discretization, shape: Shape, before: Floats) -> bool:
    """Whether something acts on a Shape on a mesh, or on the way to it.

    Shapes: before (N + 1, 3).
    """
    found = np.empty(1, dtype=bool)
    _fill_acting(mesh.full, shape.element_strains[None], shape.positions[None], before[None], found)
    return bool(found[0])


def acting_on(mesh: Discretization, strains: Floats, positions: Floats, before: Floats) -> Bools:
    """Return (n,) whether something acts on shapes, or on the straight way to them.

    Shapes: strains (n, N, 3), positions, before (n, N + 1, 3).
    """
    found = np.empty(len(strains), dtype=bool)
    freeze([strains, positions, before])
    _fill_acting(mesh.full, strains, positions, before, found)
    return found


@kernel
def _fill_acting(system: Problem, strains: Floats, positions: Floats, before: Floats,
                 found: Bools) -> None:
    """Fill found (n,) as `acting_on`; the arrays are read-only."""
    for k in range(found.size):
        found[k] = may_act(system.effects, system, strains[k], positions[k], before[k])


def _before(free: Discretization, before: Shape | None, gripper: Pose) -> Floats:
    """Return where the nodes of a mesh are in the Shape `before`, or without it stress-free."""
    if before is None:
        strains, pose = np.array(free.natural), gripper
    elif free.has_nodes(before.s):
        return before.positions
    else:
        strains, pose = free.strains_from(before.s, before.element_strains), before.gripper
    there: Floats = configuration_at(free.system(pose.rotation), strains).positions + pose.position
    freeze(there)
    return there


def _freed(shape: Shape, free: Discretization) -> tuple[Memory, Memory]:
    """Return the past of a Shape on a mesh without what may act, after and before its step."""
    known = shape.state.history
    if known is None or shape.far_end is None:
        return free.start, free.start
    left = _left(shape.state.made_on, known.left)
    return free.start.followed(known.positions, known.tangents, **left), free.start


def _left(mesh: Discretization, left: Left) -> dict[str, Any]:
    """Return what those leave that act on a mesh and are not left out where it hangs freely."""
    return {name: left[name] for name in mesh.left_anyway}


def _on(shape: Shape, mesh: Discretization, past: tuple[Memory, Memory]) -> Shape:
    """Return the same Shape on another mesh of the same nodes, with its past after and before."""
    known = shape.state
    return with_state(shape, State(mesh, *past, known.estimate, known.error_ratio))
