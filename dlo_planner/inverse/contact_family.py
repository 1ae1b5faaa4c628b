# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All shapes with one contact: a curve, by the force of contact (paper, Fig. 16).

Arc length, place, direction and roll at the contact are given. The DLO beyond it is then a
cantilever, whose force and moment are known there; only the force of contact is free. One
integration from the free end to the gripper gives the shape for each force: a smooth curve, without
a search. A shape is admissible if it is a minimum with the contact as a constraint and lies in no
obstacle. These parts of the curve are intervals of the force: a scan over its decades finds them.
Where the middle of three samples is the best, but not admissible, a search looks for an interval
between them. A root finder finds the ends.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import equilibrium, shape_of
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.gap import along_the_dlo, signed_distance
from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.scene import Scene
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.inverse.equilibria import hanging
from dlo_planner.minimize.convergence import Minimum, residual_of
from dlo_planner.minimize.newton import descend
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface, part_of_loads, part_of_rod
from dlo_planner.model.varying import SeenFrom
from dlo_planner.plan.clearance import nearest

_PER_DECADE = 8
_END = 1e-6     # relative: how well the ends of an interval are found
_SAMPLES = 9    # of an interval at least
_CLOSE = 1e-5   # relative: how well a minimum is found
_ALIKE = 1e-9   # relative: costs that differ by less are alike
_LOOKED_CLOSER = 4  # places where an interval may hide
_WORST = 1e6    # stands for no value at all


def intervals(merit: Callable[[float], float], least: float, most: float) -> list[list[float]]:
    """Return the intervals of x > 0 in which `merit` is positive, each as samples (n,) ascending.

    The first and last sample are the ends, inside the interval by a part of 1e-6 at most.
    """
    number = int(np.ceil(_PER_DECADE * np.log10(most / least))) + 2
    xs = [float(x) for x in np.geomspace(least, most, number)]
    xs = sorted({*xs, *_hidden(merit, xs)})
    good = [merit(x) > 0 for x in xs]
    intervals_found, k = [], 0
    while k < len(xs):
        if not good[k]:
            k += 1
            continue
        first = k
        while k + 1 < len(xs) and good[k + 1]:
            k += 1
        ends = ([_end(merit, xs[first], xs[first - 1])] if first else [],
                [_end(merit, xs[k], xs[k + 1])] if k + 1 < len(xs) else [])
        intervals_found.append(_filled(sorted({*ends[0], *xs[first:k + 1], *ends[1]})))
        k += 1
    return intervals_found


def _hidden(merit: Callable[[float], float], xs: list[float]) -> list[float]:
    """Return points of positive merit between samples `xs` of negative merit."""
    values = [merit(x) for x in xs]
    tops = [k for k in range(1, len(xs) - 1)
            if 0 >= values[k] >= max(values[k - 1], values[k + 1]) > -np.inf]
    points = []
    for k in sorted(tops, key=lambda k: -values[k])[:_LOOKED_CLOSER]:
        best = minimize_scalar(lambda log: -_finite(merit(float(np.exp(log)))), method='bounded',
                               bounds=np.log([xs[k - 1], xs[k + 1]]), options={'maxiter': 20})
        if best.fun < 0:
            points.append(float(np.exp(best.x)))
    return points


def _end(merit: Callable[[float], float], good: float, bad: float) -> float:
    """Return the last x of positive merit on the way from `good` to `bad`."""
    # by x itself: the logarithm's rounding could carry an end over a leap of the merit
    root = brentq(lambda x: _finite(merit(x)), good, bad, xtol=_END * min(good, bad))
    back = _END if good > bad else -_END
    for steps in (0, 1, 2, 4):
        x = float(root * (1 + steps * back))
        if merit(x) > 0:
            return x
    return good


def _finite(value: float) -> float:
    return max(value, -_WORST)


def _filled(xs: list[float]) -> list[float]:
    """Return ascending `xs` with as many between them as make an interval's samples."""
    while 1 < len(xs) < _SAMPLES:
        xs = sorted({*xs, *(float(x) for x in np.sqrt(np.multiply(xs[1:], xs[:-1])))})
    return xs


def minima(cost: Callable[[float], float], merit: Callable[[float], float],
           xs: list[float]) -> list[tuple[float, float]]:
    """Return [(cost, x)], best first: the local minima of `cost` over an interval."""
    def judged(log: float) -> float:
        x = float(np.exp(log))
        return cost(x) if merit(x) > 0 else worst

    values = [cost(x) for x in xs]
    worst = max(values) + 1.0
    pairs = []
    for k, x in enumerate(xs):
        around = xs[max(k - 1, 0):k + 2]
        if values[k] > min(values[max(k - 1, 0):k + 2]):
            continue
        pairs.append((values[k], x))
        if len(around) > 1:
            best = minimize_scalar(judged, method='bounded', bounds=np.log([around[0], around[-1]]),
                                   options={'xatol': _CLOSE})
            if best.fun < values[k]:
                pairs[-1] = (float(best.fun), float(np.exp(best.x)))
    return best_first(pairs)


def best_first(pairs: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return pairs (cost, x) ordered by cost; where costs differ by rounding errors only, by x."""
    unit = _ALIKE * max((abs(cost) for cost, _ in pairs), default=0.0) or 1.0
    return sorted(pairs, key=lambda one: (round(one[0] / unit), one[1]))


STABLE = 0.02       # least stability: a mesh's error does not make it doubtful
_OUTSIDE = 1e-9     # of the length: rounding errors of a gap
_BALANCED = 1e-8    # of the residual
_ON_SURFACE = 1e-4  # of the length, and rad: how far a contact may be off its obstacle


class ContactFamily:
    """The shapes that touch at arc length `s` in a given way, by the force of contact.

    Parameters
    ----------
    simulator
        DirectSimulator with the obstacle among its obstacles.
    contact
        Pose on the obstacle's surface: x axis = DLO's direction, z axis = outward normal; its axes
        are those of the DLO's material frame there.
    s
        Arc length of the contact in m.
    check
        Called once a shape, as `Progress.check`.
    elements
        Elements of the mesh.

    Attributes
    ----------
    s : float
        Arc length of the contact in m.
    place : ndarray, shape (3,)
        Position of the DLO's axis there, m.
    frame : ndarray, shape (3, 3)
        Frame of the DLO there.
    obstacle : int
        Index of the obstacle that is touched.
    scale : (float, float)
        Smallest and largest of the forces that are natural for this DLO, N.
    stable : float
        Least stability of an admissible shape.
    known : dict of float to Shape
        The shapes that were computed, by their force.

    Raises
    ------
    InvalidTask
        The contact is not on the surface of an obstacle.
    """

    def __init__(self, simulator: DirectSimulator, contact: Pose, s: float,
                 check: Callable[[], None], elements: int = 64) -> None:
        self.s, self.stable, self._check = s, STABLE, check
        self.known: dict[float, Shape] = {}
        around, rod = _about_the_axis(simulator.surroundings), simulator.rod
        thick = float(around.rod.radii([s])[0])
        self._mesh, self._node = _mesh(around, s, elements)
        self._alone = Discretization(replace(around, obstacles=()), self._mesh.s, 'local', 0)
        self._rolling = self._mesh
        if self._node < elements:
            self._rolling = Discretization(around, np.delete(self._mesh.s, self._node), 'local', 0)
        self._scene = self._mesh.static.scene
        self._body, self.place, self.frame = _placed(self._scene, contact, thick, rod.length)
        self.obstacle = int(self._scene.source[self._body])
        self._end, strain = _cantilever(self._alone, self._node, self.frame)
        self._inside = self._sag(strain)
        weight = float(np.linalg.norm(self._mesh.static.pull, axis=1).sum())
        stiffness = rod.stiffness[1:]
        bent = float(np.abs(self._mesh.natural).max())
        self.scale = (weight + stiffness.min() / rod.length**2,
                      weight + stiffness.max() * (1 / s + bent) / s)

    def shape(self, force: float) -> Shape:
        """Return the Shape with this force of contact, N; it may not be admissible."""
        if force not in self.known:
            self._check()
            self.known[force] = self._marched(force)
        return self.known[force]

    def _marched(self, force: float) -> Shape:
        system = self._alone.full._replace(base=np.eye(3))  # of one kind with that which touches
        pull = system.pull.copy()
        pull[self._node] -= force * self.frame[:, 2]
        system = system._replace(pull=pull)
        state, base = hanging(system, self._end)
        if not np.isfinite(base).all():
            raise InvalidTask(f'forces: {force:g} N bends the DLO beyond all numbers; expected '
                              f'some {self.scale[1]:.2g} N or less')
        gripper = Pose.from_rotation(self.place - state.positions[self._node], base)
        touching = self._mesh.system(base, gripper.position)
        touching.contacts.node[self._body, self._node] = force
        minimum = Minimum(state, residual_of(system, state),
                          self._stability(state.strains, base, force), 0, 0, touching)
        shape = shape_of(self._mesh, gripper, minimum)
        touching_there: Shape = replace(shape, violation=max(0.0, -self.gap(shape), self._inside))
        return touching_there

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
        """Return the depth, m, of a DLO that curves into the obstacle at the contact.

        Shapes: strain (3,).
        """
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

        Continuous, except for -inf where the integration does not end in an equilibrium.
        """
        shape = self.shape(force)
        length = float(shape.s[-1])
        if shape.violation > _OUTSIDE * length:
            return -shape.violation / length
        return shape.stability - self.stable if shape.residual < _BALANCED else -np.inf

    def most_stable(self) -> Shape | None:
        """Return the most stable of the known Shapes that are in no obstacle, or None."""
        good = [shape for shape in self.known.values() if shape.residual < _BALANCED
                and shape.violation <= _OUTSIDE * shape.s[-1]]
        return max(good, key=lambda shape: shape.stability, default=None)


def _about_the_axis(surroundings: Surroundings) -> Surroundings:
    """Return Surroundings whose DLO is round, as thick as a rectangular one along its b axis.

    The b axis points away from the obstacle that is touched.
    """
    half = Surface.of(surroundings.rod).half
    if half is None:
        return surroundings
    return replace(surroundings, rod=replace(surroundings.rod, radius=half[1], section=None))


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
    # among foils and obstacles that meet there, the one with this normal
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
    """Return the rotation (3, 3) of the free end, and the strain (3,) at the contact.

    The DLO beyond the contact is released from its natural shape.
    """
    if node == mesh.s.size - 1:
        return np.array(frame, order='C'), mesh.natural[-1]
    around = mesh.surroundings
    s, load = mesh.s[node], around.load
    part = replace(around, rod=part_of_rod(mesh.rod, s, 1),
                   load=SeenFrom(load, s, 1) if callable(load) else load,
                   point_loads=part_of_loads(around.point_loads, around.rod, s, 1))
    tail = Discretization(part, mesh.s[node:] - s, 'local', 0)
    shape, _ = equilibrium(tail, Pose.from_rotation(np.zeros(3), frame), tail.natural)
    return np.array(shape.frames[-1], order='C'), shape.strains[0]
