# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shapes that pass one center along a normal, at each depth."""

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.statics import TOLERANCE, found_hanging, shape_of
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.inverse.solvers.continuation.following import Passing
from dlo_planner.inverse.solvers.hanging.sphere import crossings
from dlo_planner.inverse.solvers.points.aligned import aligned_newton, free_axis
from dlo_planner.inverse.solvers.points.coupled import aligned_hanging
from dlo_planner.inverse.solvers.points.nested import nested_alignment
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.model.pose import Pose

_MAX_ITERATIONS = 60
_ORIGIN = np.zeros(3)


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

    def __init__(self, simulator, normal, method='coupled'):
        self.simulator, self.normal = simulator, normal
        self._align = {'coupled': aligned_shape, 'nested': _nested}[method]

    def axis(self, shape):
        """Return the axis (3,) of the free roll: the mean of the gripper's and the normal."""
        return free_axis(shape.gripper.rotation, self.normal)

    def at(self, before, depth, roll=0.0, final=False):
        """Return the Passing at `depth`; see `following.Task`."""
        reference = before.shape.gripper.rotation
        if roll:
            reference = Rotation.from_rotvec(
                roll * self.axis(before.shape)).as_matrix() @ reference
        return self.from_guess(before.shape, depth, reference, final)

    def from_guess(self, guess, depth, reference, final=True):
        """Return the Passing near a Shape, not turned about the free axis since `reference`."""
        align = self._align if final else aligned_shape
        s = self.simulator.rod.length - depth
        shape = align(self.simulator, guess, s, self.normal, reference)
        return None if shape is None else Passing(
            shape, shape.gripper.position - shape.frame_at(s)[1])

    def crossings(self, shapes, depth):
        """Return where the shapes at `depth` cross the grid of HangingShapes."""
        s = self.simulator.rod.length - depth
        return crossings(shapes, shapes.at(s)[1], self.normal, s)


def _angle(one, other):
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def aligned_shape(simulator, guess, s, normal, reference):
    """Return the Shape whose tangent at `s` is `normal`, by `aligned_newton`, or None.

    Parameters
    ----------
    guess
        Shape near it.
    reference
        (3, 3) gripper rotation since which it does not turn freely.
    """
    discretization = guess.state.mesh
    for _ in range(6):
        shape = aligned_on(discretization, guess, s, normal, reference)
        if shape is None:
            return None
        better = simulator.discretization(shape.gripper, shape)
        if better is discretization:
            return shape
        discretization, guess = better, shape
    return shape


def aligned_on(discretization, guess, s, normal, reference):
    """Return what `aligned_shape` returns, on a Discretization."""
    element = min(int(np.searchsorted(discretization.s, s, side='right')) - 1,
                  discretization.s.size - 2)
    fraction = (s - discretization.s[element]) / discretization.static.lengths[element]
    asked = (element, fraction, np.array(normal), np.array(reference, order='C'),
             free_axis(reference, normal), TOLERANCE, _MAX_ITERATIONS)
    if discretization.hangs:
        found, base, converged = aligned_hanging(discretization.static, guess.gripper.rotation,
                                                 discretization.start_from(guess), *asked)
        return found_hanging(discretization, Pose.from_rotation(_ORIGIN, base),
                             found) if converged else None
    system = discretization.system(guess.gripper.rotation)
    q = np.empty((discretization.n_unknowns, 3))
    unknowns_of(system, discretization.strains_from(guess.s, guess.element_strains), q)
    state, base, residual, _, stability, iterations, converged = aligned_newton(system, q, *asked)
    if not converged:
        return None
    return shape_of(discretization, Pose.from_rotation(_ORIGIN, base),
                    Minimum(state, residual, stability, iterations, 0, system))


def _nested(simulator, guess, s, normal, reference):
    """Return the aligned Shape by the paper's nested minimization, or None."""
    shape = nested_alignment(simulator, guess, s, normal, reference)
    aligned = _angle(shape.at(s).direction, normal) < 1e-8
    return shape if shape.converged and aligned else None
