# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a shape answers to its gripper and to what else holds it: see `minimize.response`."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.search import evaluated
from dlo_planner.direct.shape import Shape, refuse_self_contact, refuse_sliding
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import forward_kinematics
from dlo_planner.minimize.response import (
    add_slip,
    hanging_answers,
    hanging_slopes,
    hold_answers,
    linearize,
    node_twists,
    strain_answers,
    twists_inside,
)
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import displaced


class Sensitivity:
    """Derivatives of a Shape by the pose of its gripper, and of each of its A holds.

    All other grips rest. What slides with friction does so in the same points of the DLO: how these
    roll along it is left out, by which columns of 50 random shapes that lay on a floor were off by
    0.4 % in the median, 9 % at most.

    Parameters
    ----------
    shape : Shape
        Converged Shape of a simulator (not from a file, not grasped inside), which sticks in all
        rings that it may slide through.

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
        refuse_sliding('shape', shape)
        refuse_self_contact('shape', shape)
        self.shape = shape
        here, gripper = shape.state.mesh, shape.gripper
        # the past before the step: what yields in it, yields along with the gripper
        system = here.system(gripper.rotation, gripper.position, shape.state.held, shape.holds,
                             culled=shape.state.culled)
        self._system, self._state, self._answers, self._hessian, self._columns = linearize(
            system, here.unknowns(shape.element_strains))
        self._slides = any(np.any(contact.friction) for contact in shape.contacts)
        if self._slides:
            add_slip(self._system, self._state, self._hessian, self._answers, True)

    def at(self, s: float) -> Floats:
        """Return (6, 6): rotation and displacement of the frame at `s` (m) by those of the gripper.

        World axes; the gripper turns about its own origin. The DLO gives way as it does in
        equilibrium.
        """
        element, fraction = self._place(s)
        return twists_inside(
            self._system, self._state, self._answers, self._columns,
            self._nodes[element], element, fraction)

    def by_grips(self, s: float) -> Floats:
        """Return (6, 6 + 6 A): as `at`, by the twist of the gripper, then by that of each hold.

        Each of them turns about the origin of its own pose.
        """
        element, fraction = self._place(s)
        return np.hstack([self.at(s), *(
            twists_inside(self._system, self._state, answers, 6, nodes[element], element, fraction)
            for answers, nodes in self._of_holds)])

    def _place(self, s: float) -> tuple[int, float]:
        """Return the element that `s` (m) is in, and the part of it before."""
        nodes = self.shape.s
        element = min(int(nodes.searchsorted(s, side='right')) - 1, nodes.size - 2)
        return element, float((s - nodes[element]) / (nodes[element + 1] - nodes[element]))

    @cached_property
    def _of_holds(self) -> list[tuple[Floats, Floats]]:
        """Of each hold the answers (6, m, 3) of the unknowns, and twists (N + 1, 6, 6) of nodes."""
        if not self.shape.holds:
            return []
        answers = hold_answers(self._system, self._state, self._hessian)
        if self._slides:
            add_slip(self._system, self._state, self._hessian, answers, False)
        return [(one, node_twists(self._system, self._state, one, -6))
                for one in answers.reshape(-1, 6, *answers.shape[1:])]

    @cached_property
    def _nodes(self) -> Floats:
        """(N + 1, 6, 6) the same at all nodes: of one shape, several places are asked for."""
        return node_twists(self._system, self._state, self._answers, self._columns)

    @property
    def strains(self) -> Floats:
        """(N, 3, 6) derivatives of the elements' strains by the gripper's twist."""
        return self._strains(self._answers)

    @property
    def strains_by_holds(self) -> Floats:
        """(N, 3, 6 A) the same by the twist of each hold."""
        parts = [self._strains(answers) for answers, _ in self._of_holds]
        return np.concatenate([np.zeros((self.shape.s.size - 1, 3, 0)), *parts], axis=2)

    def _strains(self, answers: Floats) -> Floats:
        """Return (N, 3, k) the change of the elements' strains with answers (k, m, 3)."""
        values = np.moveaxis(answers, 0, 2)
        if self._system.basis.shape[1]:
            values = np.einsum('iem,mik->eik', self._system.basis, values)
        result: Floats = self._system.scale[:, :, None] * values
        return result

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


class HangingSensitivities:
    """The same of n Shapes that hang freely on one mesh, at once: of strains, by turns and loads.

    `Sensitivity` makes a Problem of each of them; that takes ten times longer than its answers.
    """

    def __init__(self, mesh: Discretization, shapes: Sequence[Shape]) -> None:
        self.mesh = mesh
        self.strains = np.array([shape.element_strains for shape in shapes])
        self.grippers = np.array([shape.gripper.rotation for shape in shapes])
        self._q = np.array([mesh.unknowns(strains) for strains in self.strains])

    @staticmethod
    def mesh_of(shapes: Sequence[Shape]) -> Discretization | None:
        """Return the mesh on which all of some Shapes hang freely in a clamp; None: they do not."""
        mesh = shapes[0].state.mesh
        if mesh is None or mesh.surroundings.has_moments or mesh.surroundings.pinned:
            return None
        hang = all(shape.state.mesh is mesh and not shape.holds
                   and (mesh.hangs or shape.state.culled) for shape in shapes)
        return mesh if hang else None

    def answers(self, slopes: Floats) -> tuple[Floats, Floats]:
        """Return changes of strains by the grippers' turns (n, 3, N, 3), and by slopes, as those.

        Shapes: slopes (n, k, N, 3) of the potential by the strains, J m.
        """
        found = hanging_answers(self.mesh.free, self.grippers, self._q, slopes)
        return found[:, :3], found[:, 3:]

    def slope_of(self, more: Floats | float = 0.0, **fields: Floats) -> Floats:
        """Return (n, N, 3) what `Sensitivity.slope_of` does of each."""
        system = self.mesh.free._replace(basis=np.zeros((3, 0, 0)), **fields)
        return hanging_slopes(system, self.grippers, self.strains + more)
