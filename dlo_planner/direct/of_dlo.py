# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What follows from a shape and the DLO that it is of: strains of its section, vibrations."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from dlo_planner.direct.curve import Curve
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.direct.modes import Modes, modes_of
from dlo_planner.direct.state import State
from dlo_planner.direct.vibration import Linearized
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Rod
from dlo_planner.model.section import Section
from dlo_planner.model.surface import Surface
from dlo_planner.ritz.self_distance import may_head_back, self_distance

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.shape import Shape


class OfDLO(Curve):
    """What a Shape knows of its DLO; a base of it.

    Attributes
    ----------
    state : State
        As of `Shape`.
    """

    state: State

    @property
    def rod(self) -> Rod | None:
        """The Rod; None for a shape from a file."""
        return None if self.state.mesh is None else self.state.mesh.rod

    @property
    def mesh(self) -> Discretization | None:
        """The Discretization it was computed on; None for a shape from a file."""
        return self.state.mesh

    @property
    def history(self) -> History | None:
        """What the DLO carries to the next step: its permanent set and its contacts."""
        return self.state.history

    @property
    def pinned(self) -> bool:
        """Whether its beginning is pinned by the gripper, not clamped (a simulator's `grip`)."""
        return self.state.mesh is not None and self.state.mesh.surroundings.pinned

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles of its simulator; () for a shape from a file."""
        return () if self.state.mesh is None else self.state.mesh.surroundings.obstacles

    @property
    def bend_margin(self) -> float:
        """How much less than the rod's max_bend_curvature the sharpest bend is, 1/m (< 0: more).

        nan without a limit: nothing was looked at.
        """
        limit = None if self.rod is None else self.rod.max_bend_curvature
        return np.nan if limit is None else float(limit - 1 / self.bend_radius.min())

    @property
    def self_distance(self) -> float:
        """Least distance in m of its axis from itself, within 1e-6 of the length.

        Of places that are no neighbours: between them it heads back towards the first. Infinite if
        it heads back nowhere; nan where not known, of a DLO without a radius or from a file. What
        is below the diameter lies in itself, see `lies_in_itself`: nothing holds it off.
        """
        return self._near_itself[0]

    @property
    def lies_in_itself(self) -> bool:
        """Whether two of its pieces, no neighbours, are nearer than their radii.

        By the least half size of a rectangular section; False where `self_distance` is nan.
        """
        return self._near_itself[1] < 0

    @cached_property
    def _near_itself(self) -> tuple[float, float]:
        """Return `self_distance`, and the least distance less both radii, m; computed once."""
        radii = _radii_of(cast('Shape', self))
        if radii is None:
            return np.nan, np.nan
        distance, gap = self_distance(*self.for_kernels, radii, np.inf, np.inf)
        return float(distance), float(gap)

    @property
    def bent(self) -> Floats:
        """(N_L, 3) strains since the stress-free shape, permanent set included there, 1/m.

        Raises
        ------
        InvalidTask
            The shape comes from a file and does not know its rod.
        """
        mesh = self.state.mesh
        if mesh is None:
            raise InvalidTask('this shape does not know its rod: expected one from a simulator')
        return self.element_strains - mesh.stress_free(self.state.history)

    @property
    def surface_strain(self) -> Floats:
        """(N_L, 2) largest axial and shear strain at the surface; needs `Rod.section`."""
        return self._section().surface_strain(self.bent)

    @property
    def surface_stress(self) -> Floats:
        """(N_L, 2) largest axial and shear stress at the surface, Pa; needs `Rod.section`.

        Elastic, and so an upper bound where the section has yielded.
        """
        section = self._section()
        moduli: Floats = np.array([section.youngs_modulus, section.shear_modulus])
        return self.surface_strain * moduli

    def _section(self) -> Section:
        if self.rod is None or self.rod.section is None:
            raise InvalidTask('Rod.section = None: expected a Section where strain and stress at '
                              'the surface are asked for (Rod.circular and the like give one)')
        return self.rod.section

    def modes(self, n: int = 4) -> Modes:
        """Return the n slowest vibrations of the DLO about this shape, the grips at rest.

        Contacts that bear stay closed, what yields springs back. There are fewer than n where the
        masses cannot move in as many ways. About 1 ms with a series, see `Modes.error_estimate`.

        Raises
        ------
        InvalidTask
            The shape is not converged, neutral, one of a motion, grasped inside (take its `parts`)
            or from a file; dead moments act, or it touches something with friction.
        """
        return modes_of(cast('Shape', self), n)

    def stiffness_matrix(self) -> Floats:
        """Return (c, c), J: second derivative of the potential by the coordinates of vibrations.

        Coordinates are what the simulator minimizes by, term after term of its series ('local':
        element after element), for each torsion, curvature about n, about b. Their unit is sqrt(J),
        so scaled that the elastic part is the identity (where the stiffness does not vary along the
        DLO). A held far end leaves combinations of these. `jacobian` says what they move.

        Raises
        ------
        InvalidTask
            As `modes`.
        """
        return Linearized(cast('Shape', self)).vibration.stiffness

    def mass_matrix(self) -> Floats:
        """Return (c, c), J s^2: second derivative of the kinetic energy by the velocities.

        In the coordinates of `stiffness_matrix`, for shapes as there; it may be singular.
        """
        return Linearized(cast('Shape', self)).vibration.mass

    def jacobian(self) -> Floats:
        """Return (N_L + 1, 3, c), m, world axes: displacement of the nodes by the coordinates.

        In those of `stiffness_matrix`, for shapes as there; the grips at rest.
        """
        return Linearized(cast('Shape', self)).vibration.jacobian



def in_itself(shape: Shape, surface: Surface) -> float:
    """Return by how much, in m, a Shape with this Surface lies in itself; 0 where it does not."""
    if surface.radius == 0.0 or not may_head_back(shape.s, shape.element_strains):
        return 0.0
    _, gap = self_distance(*shape.for_kernels, _radii(surface, shape.s), 0.0, 0.0)
    return -float(gap)


def _radii(surface: Surface, s: Floats) -> Floats:
    """Return (N,) how far a Surface is from the axis at least in the elements of `s`, m."""
    if surface.rod is None:
        return np.full(s.size - 1, surface.least)
    radii: Floats = surface.radii(s).min(axis=1)
    return radii


def _radii_of(shape: Shape) -> Floats | None:
    """Return the `_radii` of a Shape; None where it has none."""
    if shape.parts is not None:  # of one grasped inside, the first runs against its arc length
        back, on = (_radii_of(part) for part in shape.parts)
        return None if back is None or on is None else np.concatenate([back[::-1], on])
    if shape.rod is None or shape.rod.radius is None:
        return None
    return _radii(Surface.of(shape.rod), shape.s)
