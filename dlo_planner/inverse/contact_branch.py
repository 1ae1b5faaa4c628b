# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All shapes with one contact: a curve, by the force of contact (paper, Fig. 16).

Arc length, place, direction and roll at the contact are given. The DLO beyond it is then a
cantilever, whose force and moment are known there; only the force of contact is free. One
integration from the free end to the gripper gives the shape for each force: a smooth curve, without
a search. A shape is admissible if it is a minimum with the contact as a constraint and lies in no
obstacle.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.equilibrium import equilibrium, shape_of
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.gap import along_the_dlo
from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.problem import Configuration
from dlo_planner.energy.scene import Scene, signed_distance
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.inverse.equilibria import hanging
from dlo_planner.minimize.convergence import Minimum, residual_of
from dlo_planner.minimize.newton import descend
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface
from dlo_planner.model.supports import Surroundings
from dlo_planner.plan.clearance import nearest

STABLE = 0.02       # least stability: a mesh's error does not make it doubtful
_OUTSIDE = 1e-9     # of the length: rounding errors of a gap
_BALANCED = 1e-8    # of the residual
_ON_SURFACE = 1e-4  # of the length, and rad: how far a contact may be off its obstacle


class ContactBranch:
    """The shapes that touch at arc length `s` (m) at a Pose of the contact, by their force.

    `check` is called once a shape. Raises InvalidTask where the contact is not on an obstacle:
    x axis = DLO's direction, z axis = outward normal, axes of the DLO's material frame there.
    """

    def __init__(self, simulator: DirectSimulator, contact: Pose, s: float,
                 check: Callable[[], None], elements: int = 64) -> None:
        self.s, self._check = s, check
        self.stable = STABLE  # least stability of an admissible shape
        self.known: dict[float, Shape] = {}  # shapes that were computed, by their force, N
        around, rod = _about_the_axis(simulator.surroundings), simulator.rod
        thick = float(around.rod.radii([s])[0])
        self._mesh, self._node = _mesh(around, s, elements)
        self._rolling = self._mesh
        if self._node < elements:
            self._rolling = Discretization(around, np.delete(self._mesh.s, self._node), 'local', 0)
        self._scene = self._mesh.static.scene
        # position (3,) of the DLO's axis at the contact, m, and its frame (3, 3)
        self._body, self.place, self.frame = _placed(self._scene, contact, thick, rod.length)
        self.obstacle = int(self._scene.source[self._body])  # index of the one that is touched
        self._end, strain = _cantilever(self._mesh, self._node, self.frame)
        self._inside = self._sag(strain)
        weight = float(np.linalg.norm(self._mesh.static.pull, axis=1).sum())
        stiffness = rod.stiffness[1:]
        bent = float(np.abs(self._mesh.natural).max())
        # smallest and largest of the forces that are natural for this DLO, N
        self.scale = (weight + stiffness.min() / rod.length**2,
                      weight + stiffness.max() * (1 / s + bent) / s)
        held = self._mesh.held  # of one kind with the problem that touches, without obstacles
        self._pressed = held._replace(base=np.eye(3), pull=held.pull.copy())
        self._own_pull = held.pull[self._node].copy()

    def hanging(self, force: float) -> tuple[Configuration, Pose]:
        """Return the equilibrium with this force of contact, N, and its gripper."""
        self._pressed.pull[self._node] = self._own_pull - force * self.frame[:, 2]
        state, base = hanging(self._pressed, self._end)
        if not np.isfinite(base).all():
            raise InvalidTask(f'forces: {force:g} N bends the DLO beyond all numbers; expected '
                              f'some {self.scale[1]:.2g} N or less')
        return state, Pose.from_rotation(self.place - state.positions[self._node], base)

    def elastic_energy(self, force: float) -> float:
        """Return the elastic energy with this force, J."""
        system, state = self._pressed, self.hanging(force)[0]
        return float(0.5 * (system.stiffness * (state.strains - system.natural)**2
                            * system.lengths[:, None]).sum())

    def shape(self, force: float) -> Shape:
        """Return the Shape with this force of contact, N; not every one is admissible."""
        if force not in self.known:
            self._check()
            state, gripper = self.hanging(force)
            base = np.array(gripper.rotation)
            touching = self._mesh.system(base, gripper.position)
            touching.contacts.node[self._body, self._node] = force
            shape = shape_of(self._mesh, gripper, Minimum(
                state, residual_of(self._pressed, state), -np.inf, 0, 0, touching))
            violation = max(0.0, -self.gap(shape), self._inside)
            outside = violation <= _OUTSIDE * shape.s[-1]
            self.known[force] = replace(shape, violation=violation, stability=self._stability(
                state.strains, base, force) if outside else -np.inf)
        return self.known[force]

    def _stability(self, strains: Floats, base: Floats, force: float) -> float:
        """Return the smallest eigenvalue with the contact as a constraint.

        A DLO that turns rolls over the obstacle and touches elsewhere: that makes it more stable.
        A contact inside an element can roll, one at a node cannot; so `s` is no node of this mesh.
        """
        mesh = self._rolling
        system = mesh.system(base)
        state = configuration_at(system, mesh.strains_from(self._mesh.s, strains))
        at_end, e = self._node == self._mesh.s.size - 1, self._node - 1
        frame, x = np.empty((3, 3)), np.empty(3)
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     (self.s - mesh.s[e]) / system.lengths[e], frame, x)
        system = mesh.system(base, self.place - x)
        if at_end:
            system.contacts.node[self._body, self._node] = force
        else:
            none = np.zeros((1, 3))
            system = system._replace(contacts=system.contacts._replace(
                element=np.array([e]), obstacle=np.array([self._body]),
                multiplier=np.array([force]), fraction=np.zeros(1), anchor=none, normal=none))
        return float(descend(system, state.q, np.inf, 0, True).stability)

    def _sag(self, strain: Floats) -> float:
        """Return the depth, m, of a DLO that curves into the obstacle by a strain (3,)."""
        bend, normal = np.empty((3, 3)), np.empty(3)
        signed_distance(self._scene, self._body, np.array(self.place), normal, bend)
        _, curve = along_the_dlo(normal, bend, self.frame, strain)
        return float(-curve * np.diff(self._mesh.s).max() ** 2 / 8)

    def gap(self, shape: Shape, others: bool = False) -> float:
        """Return the smallest gap between a Shape and the obstacles, m; infinite without any."""
        gaps = nearest(self._scene, shape)
        return min((gap for source, (gap, _, _) in zip(self._scene.source, gaps, strict=True)
                    if not others or source != self.obstacle), default=np.inf)

    def merit(self, force: float) -> float:
        """Return a number that is positive where the shape with this force is admissible.

        Continuous, but -inf where the integration does not end in an equilibrium.
        """
        shape = self.shape(force)
        length = float(shape.s[-1])
        if shape.violation > _OUTSIDE * length:
            return -shape.violation / length
        return shape.stability - self.stable if shape.residual < _BALANCED else -np.inf

    def most_stable(self) -> Shape | None:
        """Return the most stable of the known Shapes that are in no obstacle, or None."""
        good = [shape for shape in self.known.values() if shape.residual < _BALANCED
                and shape.stability > -np.inf]
        return max(good, key=lambda shape: shape.stability, default=None)


def _about_the_axis(surroundings: Surroundings) -> Surroundings:
    """Return Surroundings whose DLO is round, as thick as its b axis, which touches, is long."""
    half = Surface.of(surroundings.rod).half
    if half is None:
        return surroundings
    round_rod = replace(surroundings.rod, radius=half[1], section=None, section_model=None)
    return replace(surroundings, rod=round_rod)


def _mesh(surroundings: Surroundings, s: float, elements: int) -> tuple[Discretization, int]:
    """Return a Discretization in which `s` is a node, and the index of that node."""
    length = surroundings.rod.length
    if s >= length * (1 - 1e-9):
        return Discretization(surroundings, np.linspace(0, length, elements + 1), 'local',
                              0), elements
    node = int(np.clip(round(elements * s / length), 2, elements - 2))
    nodes = np.concatenate([np.linspace(0, s, node + 1),
                            np.linspace(s, length, elements - node + 1)[1:]])
    return Discretization(surroundings, nodes, 'local', 0), node


def _placed(scene: Scene, contact: Pose, radius: float,
            length: float) -> tuple[int, Floats, Floats]:
    """Return the body with the contact, and the place (3,) and frame (3, 3) of the DLO there."""
    axis = contact.position + radius * contact.rotation[:, 2]
    normals, bend = np.empty((scene.kind.size, 3)), np.empty((3, 3))
    gaps = np.array([signed_distance(scene, o, axis, normals[o], bend) - radius
                     for o in range(scene.kind.size)])
    # among layers and obstacles that meet there, the one with this normal
    tilts = np.linalg.norm(normals - contact.rotation[:, 2], axis=1)
    body = int(np.argmin(np.abs(gaps) / length + tilts))
    if abs(gaps[body]) > _ON_SURFACE * length or tilts[body] > _ON_SURFACE:
        raise InvalidTask(
            f'contact = {contact!r}: expected a place on an obstacle\'s surface, the z axis its '
            f'normal; the nearest one is {gaps[body]:.3g} m and {tilts[body]:.3g} rad off')
    normal = normals[body]
    along = contact.rotation[:, 0] - (contact.rotation[:, 0] @ normal) * normal
    along /= np.linalg.norm(along)
    frame = np.column_stack([along, np.cross(normal, along), normal])
    return body, axis - gaps[body] * normal, frame


def _cantilever(mesh: Discretization, node: int, frame: Floats) -> tuple[Floats, Floats]:
    """Return the rotation (3, 3) of a released free end, and the strain (3,) at the contact."""
    if node == mesh.s.size - 1:
        return np.array(frame, order='C'), mesh.natural[-1]
    s = mesh.s[node]
    alone = replace(mesh.surroundings.part(s, 1), obstacles=())
    tail = Discretization(alone, mesh.s[node:] - s, 'local', 0)
    shape = equilibrium(tail, Pose.from_rotation(np.zeros(3), frame), tail.natural)
    return np.array(shape.frames[-1], order='C'), shape.strains[0]
