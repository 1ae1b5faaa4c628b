# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What yielding leaves: plastic strains, and the energy lost to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.mesh import mapped
from dlo_planner.direct.part import Held, Left, Part, Solved
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.plastic import Layers, add_plastic, set_strains, settled, yields
from dlo_planner.energy.yielding import yielding_layers
from dlo_planner.model.arrays import Floats

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization


class PermanentSet(Part):
    """Springs that yield, `energy.plastic`. They leave two things.

    set: (N, J) plastic strain of each spring, 1/m; (N, 0) if elastic
    lost: energy lost to plastic deformation so far, J
    """

    name = 'plastic'
    of_rod = True
    stores = True
    rests = True

    def acts(self, around: Surroundings) -> bool:
        """Whether the DLO yields anywhere."""
        return around.rod.yields

    def given(self, mesh: Discretization) -> Layers:
        """Return the Layers without a set."""
        layers: Layers = yielding_layers(mesh.rod, mesh.bare.stiffness)
        return layers

    def record(self, mesh: Discretization, left: Left, held: Held) -> Layers:
        """Return the Layers, set as they are."""
        layers: Layers = mesh.given(self.name)
        return layers._replace(set=left['set'].copy())

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether the DLO yields."""
        return mesh.yields

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return no set."""
        springs = mesh.given(self.name).set.shape[1] if mesh.yields else 0
        return {'set': np.zeros((s.size - 1, springs)), 'lost': np.array(0.0)}

    def resampled(self, left: Left, s: Floats, wanted: Floats) -> Left:
        """Return the set averaged over other elements."""
        return {'set': mapped(s, left['set'], wanted)}

    def fits(self, left: Left, start: Left) -> bool:
        """Whether there are as many springs."""
        return bool(left['set'].shape[1] == start['set'].shape[1])

    def lasts(self, left: Left) -> bool:
        """Whether anything is set."""
        return bool(left['set'].any())

    def leaves(self, solved: Solved) -> Left:
        """Return the set after the step, and what it cost."""
        system, left = solved.system, solved.left
        if not (solved.mesh.yields and yields(system.plastic)):
            return {'set': left['set'], 'lost': left['lost']}
        new, lost = settled(system.lengths, solved.state.strains, system.natural, system.plastic)
        return {'set': new, 'lost': np.array(left['lost'] + lost)}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return the energy lost."""
        return {'dissipated': float(left['lost'])}

    def stored(self, mesh: Discretization, left: Left, strains: Floats) -> float:
        """Return the energy in the springs, which a step that has ended leaves no loss in."""
        system, layers = mesh.static, self.record(mesh, left, Held())
        return float(add_plastic(system.lengths, strains, system.natural, layers,
                                 np.zeros_like(strains)))

    def strains(self, mesh: Discretization, left: Left) -> Floats:
        """Return the strains at which the springs balance."""
        moved: Floats = set_strains(mesh.bare.stiffness, self.record(mesh, left, Held()))
        return moved
