# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a shape answers to its gripper: see `minimize.response`."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.modes import linearize
from dlo_planner.direct.search import evaluated
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import forward_kinematics
from dlo_planner.minimize.response import (
    add_slip,
    node_twists,
    strain_answers,
    twists_inside,
)
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import displaced


class Sensitivity:
    """Derivatives of a Shape by the pose of its gripper (the far end's grip stays).

    Parameters
    ----------
    shape : Shape
        Converged Shape of a simulator (not from a file, not grasped inside).

    Raises
    ------
    InvalidTask
        Another shape.
    """

    def __init__(self, shape: Shape) -> None:
        if shape.state.mesh is None or shape.state.before is None:
            raise InvalidTask('shape: expected one that comes from a simulator')
        if shape.state.mesh.surroundings.has_moments:
            raise InvalidTask('shape: expected one without dead moments, which have no potential')
        if shape.state.mesh.surroundings.pinned:
            raise InvalidTask('shape: expected one whose gripper clamps it, not a pinned one')
        self.shape = shape
        here, gripper = shape.state.mesh, shape.gripper
        # the past before the step: what yields in it, yields along with the gripper
        system = here.system(gripper.rotation, gripper.position, shape.state.held, shape.holds,
                             culled=shape.state.culled)
        self._system, self._state, self._answers, self._hessian = linearize(
            system, here.unknowns(shape.element_strains))
        if any(np.any(contact.friction) for contact in shape.contacts):
            add_slip(self._system, self._state, self._hessian, self._answers)

    def at(self, s: float) -> Floats:
        """Return (6, 6): rotation and displacement of the frame at `s` (m) by those of the gripper.

        World axes; the gripper turns about its own origin. The DLO gives way as it does in
        equilibrium.
        """
        shape = self.shape
        element = min(int(shape.s.searchsorted(s, side='right')) - 1, shape.s.size - 2)
        fraction = (s - shape.s[element]) / (shape.s[element + 1] - shape.s[element])
        return twists_inside(
            self._system, self._state, self._answers, self._hessian.cross.shape[2],
            self._nodes[element], element, float(fraction))

    @cached_property
    def _nodes(self) -> Floats:
        """(N + 1, 6, 6) the same at all nodes: of one shape, several places are asked for."""
        return node_twists(self._system, self._state, self._answers,
                           self._hessian.cross.shape[2])

    @property
    def strains(self) -> Floats:
        """(N, 3, 6) derivatives of the elements' strains by the gripper's twist."""
        values = np.moveaxis(self._answers, 0, 2)
        if self._system.basis.shape[1]:
            values = np.einsum('iem,mik->eik', self._system.basis, values)
        return self._system.scale[:, :, None] * values

    def strains_by(self, slopes: Floats) -> Floats:
        """Return (k, N, 3) the changes of the strains under k changes of the potential.

        Shapes: slopes (k, N, 3), their derivatives by the strains, J m.
        """
        return strain_answers(self._system, self._hessian, slopes)

    def slope_of(self, more: Floats | float = 0.0, **fields: Floats) -> Floats:
        """Return the potential's slope (N, 3) by the strains, the gripper's pose that of the shape.

        `more` (N, 3) is added to the strains of the shape, 1/m; other `fields` of the Problem.
        """
        # one unknown strain an element: these strains, whatever the basis
        system = self._system._replace(basis=np.zeros((3, 0, 0)), **fields)
        q = (self._state.strains + more - system.natural) / system.scale
        return evaluated(system, q).gradient / system.scale

    def moved(self, twist: ArrayLike) -> Shape:
        """Return the Shape predicted for a gripper moved by a small `twist` (6,).

        Rotation (rad) before displacement (m). Its strains change to first order; that it is an
        equilibrium is not claimed, its energy and wrench are those of before.
        """
        twist, shape = np.asarray(twist, dtype=float), self.shape
        gripper = displaced(shape.gripper, twist)
        strains = shape.element_strains + self.strains @ twist
        rotations, positions = np.empty_like(shape.frames), np.empty_like(shape.positions)
        forward_kinematics(self._system.lengths, strains, np.array(gripper.rotation), rotations,
                           positions, np.empty((len(strains), 7)))
        return replace(shape, gripper=gripper, frames=rotations, element_strains=strains,
                       positions=positions + gripper.position)
