# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A held far end: the Record of its grip, the forces that it leaves, and how well it is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dlo_planner.direct.part import Held, Left, Part, Solved, filed
from dlo_planner.energy.hold import Hold, holds, no_hold, violation
from dlo_planner.energy.system import System, tip_wrench
from dlo_planner.model.arrays import Floats
from dlo_planner.model.far_end import FarEnd, distance, spans, within_reach
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization

_KEPT = 1e-9       # of the length: by how much a grip may be missed at the end
_SLACK = 1e-3      # of the slack: the same, as the DLO pulls the tighter the less there is
_EXACT = 1e-4      # of the slack: what is aimed at
_LEAST = 1e-10     # of the length: slack that is looked at
_IN_VAIN = 30      # Newton steps towards what is out of reach
_NOTHING = np.zeros(6)
_NO_FORCES = np.zeros(0)
freeze((_NOTHING, _NO_FORCES))


class FarHold(Part):
    """The grip of the far end, `energy.hold`. It leaves one thing.

    hold: (K,) forces of the grip, N
    """

    name = 'hold'
    rests = True

    def record(self, mesh: Discretization, left: Left, held: Held) -> Hold:
        """Return the Hold, with the forces that are left if they are of as many motions."""
        free = free_end(mesh)
        if held.far_end is None or held.origin is None:
            return free
        end, rows = held.far_end, held.far_end.held
        rows[:, :3] *= mesh.lever
        known = left['hold']
        force = known.copy() if known.shape == (len(rows),) else np.zeros(len(rows))
        return free._replace(
            target=end.pose.position - held.origin, axes=np.array(end.pose.rotation, order='C'),
            share=np.array(end.share), rows=rows, multiplier=force)

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether the far end is held."""
        return held.origin is not None and held.far_end is not None

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return no forces."""
        return {'hold': np.zeros(0)}

    def judged(self, left: Left, nodes: int) -> Left:
        """Return the forces, up to six."""
        count = np.size(left.get('hold', ()))
        return {'hold': filed(left, 'hold', (min(count, 6),))}

    def cleared(self, left: Left) -> Left:
        """Return no forces."""
        return {'hold': np.zeros(0)}

    def leaves(self, solved: Solved) -> Left:
        """Return the forces."""
        if solved.far_end is None:
            return {'hold': _NO_FORCES}
        hold = solved.system.hold
        return {'hold': np.zeros(0) if hold is None else hold.multiplier}

    underway = leaves

    def with_contacts(self, before: Left, after: Left) -> Left:
        """Return the forces after the step."""
        return {'hold': after['hold']}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return force and moment on the DLO at its far end, about that end."""
        free = solved.far_end is None
        return {'far_wrench': _NOTHING if free else -tip_wrench(solved.state)}

    def constrains(self, system: System) -> bool:
        """Whether the far end is held."""
        return holds(system.hold)

    def kept(self, solved: Solved) -> bool:
        """Whether the end is where it is held: the slack of a taut DLO decides on its tension."""
        if solved.far_end is None:
            return True
        length, loaded = float(solved.mesh.s[-1]), solved.mesh.loaded
        if not within_reach(solved.far_end, solved.gripper, length, loaded):
            return False
        slack = length - distance(solved.far_end, solved.gripper)
        state = solved.state
        missed = violation(solved.system.hold, state.rotations[-1].copy(),
                           state.positions[-1].copy())
        return bool(missed <= (min(_KEPT * length, _SLACK * slack) if loaded else _KEPT * length))


class Limits(NamedTuple):
    """Of a search: Newton steps, and by what part of the length constraints may be violated."""

    steps: int
    exact: float


def limits_of(mesh: Discretization, gripper: Pose, far_end: FarEnd | None,
              usual: Limits) -> Limits:
    """Return the Limits of a search, `usual` where the far end is free.

    The less slack there is, the more its tension depends on where the end is. What is out of reach
    is given up soon.
    """
    if far_end is None:
        return usual
    length, (steps, exact) = float(mesh.s[-1]), usual
    spanned = distance(far_end, gripper)
    if not spans(spanned, length, mesh.loaded):
        steps = _IN_VAIN
    if mesh.loaded:
        exact = min(exact, _EXACT * max(1.0 - spanned / length, _LEAST))
    return Limits(steps, exact)


def free_end(mesh: Discretization) -> Hold:
    """Return the Hold of a free end."""
    return no_hold(mesh.hold_spring, mesh.hold_spring * mesh.lever**2)
