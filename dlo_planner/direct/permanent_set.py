# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What yielding leaves: plastic strains, and the energy lost to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.mesh import mapped
from dlo_planner.direct.part import Held, Left, Part, Solved, filed
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.plastic import Layers, add_plastic, set_strains, settled, yields
from dlo_planner.energy.yielding import yielding_layers
from dlo_planner.model.arrays import Floats
from dlo_planner.model.rod import Rod

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization

_FAR_BEYOND = 10.0  # yield limits: a section that is strained as far bears what it can
_ALONE = 5.0        # times as far as the elements beside it
_FEW = 5            # elements: too few to tell


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

    def judged(self, left: Left, nodes: int) -> Left:
        """Return the set of so many nodes less one, and what it cost."""
        springs = np.shape(left.get('set', ()))[1:]
        return {'set': filed(left, 'set', (nodes - 1, *(springs or (0,)))),
                'lost': filed(left, 'lost', (), lowest=0.0)}

    def resampled(self, left: Left, s: Floats, wanted: Floats) -> Left:
        """Return the set averaged over other elements."""
        return {'set': mapped(s, left['set'], wanted)}

    def fits(self, left: Left, start: Left) -> bool:
        """Whether there are as many springs."""
        return bool(left['set'].shape[1] == start['set'].shape[1])

    def idle(self, left: Left) -> bool:
        """Whether nothing is set, nor has been."""
        return not left['set'].any() and not left['lost']

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


def hinge(rod: Rod, bent: Floats) -> tuple[int, float] | None:
    """Return the element that is a plastic hinge, and its strain in yield limits; None if none is.

    Without hardening a moment beyond what the section can bear bends one element alone, the sharper
    the shorter it is. An element that is bent or twisted far beyond its limit bears its limit
    moment to 0.3 %; if the next ones but one bear 8 % less, so the moment in it is beyond that.

    Parameters
    ----------
    rod : Rod
    bent : ndarray, shape (N, 3)
        Strains of the elements less the natural ones, 1/m.
    """
    if not rod.yields or rod.hardening > 0 or len(bent) < _FEW:
        return None
    curved: Any = rod.yield_curvature or (np.inf, np.inf)  # a pair, whatever was given
    shares = np.abs(bent) / (rod.yield_torsion or np.inf, *curved)
    for share in (shares[:, 0], np.hypot(shares[:, 1], shares[:, 2])):
        at = int(share.argmax())
        beside = max(share[max(at - 2, 0):max(at - 1, 0)].max(initial=0.0),
                     share[at + 2:at + 3].max(initial=0.0))
        if share[at] > _FAR_BEYOND and share[at] > _ALONE * beside:
            return at, float(share[at])
    return None
