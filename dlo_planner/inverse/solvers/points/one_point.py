# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shapes that pass one center along a normal, at each depth."""

from itertools import pairwise, takewhile

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import NO_NODES, TOLERANCE, hanging_shape, shape_of
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.inverse.solvers.continuation.following import (
    LONGEST_STEP,
    Passing,
    steps_ahead,
)
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes, crossings
from dlo_planner.inverse.solvers.points.aligned import aligned_newton, free_axis
from dlo_planner.inverse.solvers.points.nested import nested_alignment
from dlo_planner.inverse.solvers.points.onward import aligned_onward
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose, pose_of
from dlo_planner.model.value import freeze
from dlo_planner.plan.continuity import without_doubt

_MAX_ITERATIONS = 60
_ORIGIN = np.zeros(3)
freeze(_ORIGIN)


class Aligned:
    """The shapes whose tangent, at each depth, is along a normal.

    Parameters
    ----------
    simulator
        DirectSimulator.
    normal
        (3,) unit vector.
    method
        'coupled' or 'nested', for waypoints; the quick one makes all steps between.
    """

    def __init__(self, simulator: DirectSimulator, normal: Floats, method: str = 'coupled') -> None:
        self.simulator, self.normal = simulator, normal
        self._align = {'coupled': aligned_shape, 'nested': _nested}[method]

    def axis(self, shape: Shape) -> Floats:
        """Return the axis (3,) of the free roll: the mean of the gripper's and the normal."""
        return free_axis(shape.gripper.rotation, self.normal)

    def at(self, before: Passing, depth: float, roll: float = 0.0,
           final: bool = False) -> Passing | None:
        """Return the Passing at `depth`; see `following.Condition`."""
        reference, trend = before.shape.gripper.rotation, before.trend(depth)
        if roll:
            trend = None
            reference = Rotation.from_rotvec(
                roll * self.axis(before.shape)).as_matrix() @ reference
        passing = self.from_guess(before.shape, depth, reference, final, trend)
        return passing and passing.after(before)

    def from_guess(self, guess: Shape, depth: float, reference: Floats, final: bool = True,
                   trend: tuple[Shape, float] | None = None) -> Passing | None:
        """Return the Passing near a Shape, not turned about the free axis since `reference`.

        Parameters
        ----------
        trend : (Shape, float) or None, optional
            What `Passing.trend` returns; the search begins as far ahead.
        """
        align = self._align if final else aligned_shape
        s = self.simulator.rod.length - depth
        shape = align(self.simulator, guess, s, self.normal, reference, trend)
        if shape is None:
            return None
        axes, position = shape.frame_at(s)
        return Passing(shape, shape.gripper.position - position, depth=depth, axes=axes)

    def onward(self, before: Passing, depths: Floats) -> list[Passing]:
        """Return the Passings at the first of some depths, without roll, that leave no doubt.

        As `at` finds them, in less time. There may be none: where the gripper or the DLO might
        leap, where the DLO is hardly stable, and where another mesh is needed.

        Parameters
        ----------
        before : Passing
            Passing at the depth before.
        depths : ndarray, shape (k,)
            The depths that follow, m.
        """
        mesh = before.shape.state.mesh
        if self._align is not aligned_shape or mesh is None or not mesh.hangs:
            return []
        far = np.flatnonzero(~(abs(np.diff(depths, prepend=before.depth))
                               <= LONGEST_STEP * self.simulator.rod.length))
        found = _onward(mesh, self.normal, before, depths[:far[0]] if far.size else depths)
        if self.simulator.accuracy is not None:
            found = list(takewhile(lambda passing: self._mesh_of(passing.shape) is mesh, found))
        return found

    def _mesh_of(self, shape: Shape) -> Discretization:
        """Return the Discretization that keeps the accuracy at a Shape."""
        return self.simulator.discretization(shape.gripper, shape)

    def crossings(self, shapes: HangingShapes, depth: float) -> Crossings:
        """Return where the shapes at `depth` cross the grid of HangingShapes."""
        s = self.simulator.rod.length - depth
        return crossings(shapes, shapes.at(s)[1], self.normal, s)


def _onward(mesh: Discretization, normal: Floats, before: Passing,
            depths: Floats) -> list[Passing]:
    """Return what `Aligned.onward` does, of a Discretization that hangs freely."""
    shape, length = before.shape, mesh.s[-1]
    steps = np.diff(depths, prepend=before.depth)
    most, least = without_doubt(steps / length, length)
    if not (len(depths) and shape.stability > least):
        return []
    earlier, ahead = before.trend(depths[0]) or (shape, 0.0)
    further = [steps_ahead(last, step) for last, step in pairwise(steps.tolist())]
    passings: list[Passing] = []
    for k, passing in enumerate(_searched(
            mesh, (earlier, shape), (earlier.element_strains, shape.element_strains), before.place,
            np.array([ahead, *further]), length - depths, normal, shape.gripper.rotation, most,
            least, mesh.sampled)):
        before = passing._replace(depth=float(depths[k])).after(before)
        passings.append(before)
    return passings


def _searched(mesh: Discretization, shapes: tuple[Shape, Shape], strains: tuple[Floats, Floats],
              place: Floats, ahead: Floats, s: Floats, normal: Floats, reference: Floats,
              most: Floats, least: float, nodes: Ints) -> list[Passing]:
    """Return the Passings that `aligned_onward` finds at arc lengths s (k,), m.

    Parameters
    ----------
    shapes, strains
        The Shape before the last one and the last one, and their strains on the mesh, 1/m.
    place, ahead, normal, reference, most, least, nodes
        As of `aligned_onward`.
    """
    pair = (np.array([shape.gripper.rotation for shape in shapes]), np.array(strains))
    freeze(pair)
    count, found, bases, axes, places = aligned_onward(
        mesh.static, *pair, shapes[1].frames, place, ahead, *_places(mesh.s, s), np.array(normal),
        reference, most, least, nodes, TOLERANCE, _MAX_ITERATIONS)
    passings, (strains, frames, positions, wrenches, numbers) = [], found
    for k in range(count):
        elastic, energy, residual, stability, iterations = numbers[:, k].tolist()
        shape = hanging_shape(mesh, pose_of(_ORIGIN, bases[k]), (
            strains[k], frames[k], positions[k], wrenches[k], elastic, energy, residual, stability,
            int(iterations), 0))
        passings.append(Passing(shape, -places[k], axes=axes[k]))
    return passings


def _places(nodes: Floats, s: Floats) -> tuple[Ints, Floats]:
    """Return (k,) elements in which arc lengths (k,), m, are, and (k,) fractions of them."""
    elements = np.minimum(nodes.searchsorted(s, side='right') - 1, nodes.size - 2)
    begin = nodes[elements]
    return elements, (s - begin) / (nodes[elements + 1] - begin)


def _angle(one: Floats, other: Floats) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def aligned_shape(simulator: DirectSimulator, guess: Shape, s: float, normal: Floats,
                  reference: Floats, trend: tuple[Shape, float] | None = None) -> Shape | None:
    """Return the Shape whose tangent at `s` is `normal`, by `aligned_newton`, or None.

    Parameters
    ----------
    guess : Shape
        Shape near it.
    reference : ndarray, shape (3, 3)
        Gripper rotation since which it does not turn freely.
    trend : (Shape, float) or None, optional
        As of `Passing.trend`.
    """
    discretization = guess.state.mesh
    assert discretization is not None  # a guess is made on one
    for _ in range(6):
        shape = aligned_on(discretization, guess, s, normal, reference, trend)
        if shape is None:
            return None
        if simulator.accuracy is None:  # its mesh is the same everywhere
            return shape
        better = simulator.discretization(shape.gripper, shape)
        if better is discretization:
            return shape
        discretization, guess, trend = better, shape, None
    return shape


def aligned_on(discretization: Discretization, guess: Shape, s: float, normal: Floats,
               reference: Floats, trend: tuple[Shape, float] | None = None) -> Shape | None:
    """Return what `aligned_shape` returns, on a Discretization."""
    reference = np.array(reference, order='C')
    freeze(reference)
    if discretization.hangs:
        begin = discretization.start_from(guess)
        earlier, ahead = trend or (guess, 0.0)
        if not (trend and discretization.has_nodes(guess.s)):
            earlier, ahead = guess, 0.0
        before = begin if earlier is guess else earlier.element_strains
        found = _searched(discretization, (earlier, guess), (before, begin), np.zeros(3),
                          np.array([ahead]), np.array([s]), normal, reference,
                          np.full((3, 1), np.inf), -np.inf, NO_NODES)
        return found[0].shape if found else None
    (element,), (fraction,) = (found.tolist() for found in _places(
        discretization.s, np.array([s])))
    system = discretization.system(guess.gripper.rotation)
    q = np.empty((discretization.n_unknowns, 3))
    unknowns_of(system, discretization.strains_from(guess.s, guess.element_strains), q)
    state, base, residual, _, stability, iterations, converged = aligned_newton(
        system, q, element, fraction, np.array(normal), np.array(reference),
        free_axis(reference, normal), TOLERANCE, _MAX_ITERATIONS)
    if not converged:
        return None
    shape: Shape = shape_of(discretization, Pose.from_rotation(_ORIGIN, base),
                            Minimum(state, residual, stability, iterations, 0, system))
    return shape


def _nested(simulator: DirectSimulator, guess: Shape, s: float, normal: Floats,
            reference: Floats, trend: tuple[Shape, float] | None = None) -> Shape | None:
    """Return the aligned Shape by the paper's nested minimization, or None."""
    del trend
    shape = nested_alignment(simulator, guess, s, normal, reference)
    aligned = _angle(shape.at(s).direction, normal) < 1e-8
    return shape if shape.converged and aligned else None
