# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What may act on a DLO in a simulator: of the effects of `energy.effects`, those it offers.

An effect that depends on how the DLO is held, leaves something to the next step or is reported is
a Part in a file of this folder, and a line in ACTING.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from dlo_planner.direct.far_hold import FarHold
from dlo_planner.direct.part import Held, Left, Part
from dlo_planner.direct.permanent_set import PermanentSet
from dlo_planner.direct.touch import Touch
from dlo_planner.energy.effects import EFFECTS, Effects
from dlo_planner.energy.inertia import Anchor, no_anchor
from dlo_planner.energy.loads import Load
from dlo_planner.energy.yielding import elastic_part
from dlo_planner.model.arrays import Floats
from dlo_planner.model.rod import Rod
from dlo_planner.ritz.record import Record

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization


class Inertia(Part):
    """Inertia, `energy.inertia`, which `direct.stepping` brings; at rest there is none."""

    name = 'anchor'
    rests = True

    def record(self, mesh: Discretization, left: Left, held: Held) -> Anchor:
        """Return the Anchor of a DLO at rest."""
        return no_anchor()


ACTING: tuple[Part, ...] = (PermanentSet(), Inertia(), FarHold(), Touch())


def always(rod: Rod, pull: Floats) -> Effects:
    """Return the Effects that act on every DLO: elasticity, and loads whose `pull` (N + 1, 3)."""
    known = {'elastic': elastic_part(rod), 'load': Load(pull)}
    return Effects(*[known.get(name) for name in EFFECTS])


def others(mesh: Discretization, left: Left) -> dict[str, Record | None]:
    """Return all others by their names, without a past: empty where there is no such thing."""
    return {part.name: part.record(mesh, left, Held()) for part in ACTING}


def changing(mesh: Discretization, held: Held) -> list[Part]:
    """Return those that depend on what is left and how the DLO is held there."""
    return [part for part in ACTING if part.changes(mesh, held)]
