# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Vibrations of a DLO about a shape at rest: frequencies, damping, mode shapes, and the matrices.

Small motions y about an equilibrium obey  M y'' + K y = 0  while the grips rest. K is the second
derivative of the potential with its reactions (weight, dead forces, contacts that bear). M is the
second derivative of the kinetic energy by the velocities, with the masses on the nodes as in
`simulate`. The coordinates y are:
* The unknowns q (m, 3) of the simulator, flattened: the terms of its series ('local': elements)
  for torsion, curvature about n, about b. They are scaled so that the elastic energy is half the
  sum of their squares (exactly so where the stiffness does not vary along the DLO).
* Three more with a pinned gripper: the rotation of the beginning.
* With other holds, coefficients of an orthonormal basis of the changes that they allow.

Torsion of a straight DLO moves no mass, so M is singular. The eigenvalue problem is therefore
M x = mu K x with mu = 1 / omega^2; K is positive definite at a stable shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy

from dlo_planner.blas import one_thread
from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.direct.search import KEPT, Search, evaluated, hinge_unknowns, minimum, with_hinge
from dlo_planner.energy.elastic import purely_elastic
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.plastic import PlasticSection
from dlo_planner.energy.problem import Problem
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.convergence import CONVERGED, residual_of
from dlo_planner.minimize.hessian import Hessian
from dlo_planner.minimize.newton import HELD_NEUTRAL
from dlo_planner.minimize.response import linearize, node_twists
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import estimate, results
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, freeze, put

_AT_REST = 1e-4   # residual above which a shape is not at rest; rounding errors are below it
_MOST = 200       # Newton steps on a finer mesh
_DEPENDENT = 1e-7  # of the largest singular value of constraint rows: below it they depend


@dataclass(frozen=True)
class Vibration:
    """The linearized DLO; c coordinates, N + 1 nodes, world axes."""

    stiffness: np.ndarray   # (c, c) J per square of the coordinates' unit
    mass: np.ndarray        # (c, c) J s^2, the same
    jacobian: np.ndarray    # (N + 1, 3, c) displacement of the nodes by the coordinates, m
    strains: np.ndarray     # (N, 3, c) change of the element strains, 1/m
    carried: np.ndarray     # (N + 1, 3, 6) displacement of the nodes per displacement (3) and
                            # rotation (3, about its origin) of a slowly moving gripper: always in
                            # equilibrium
    masses: np.ndarray      # (N + 1,) kg
    resistance: np.ndarray  # (N, 3) length times stiffness of the elements, N m^3


@dataclass(frozen=True)
class Linearized:
    """An equilibrium, and the Vibrations about it on its own mesh and on finer ones."""

    name: str             # in messages
    mesh: Discretization
    gripper: Pose
    holds: Holds
    strains: Floats       # (N, 3) 1/m
    residual: float
    before: Memory        # what the step began with that led there,
    held: Memory          # and the same under the forces after it

    @cached_property
    def vibration(self) -> Vibration:
        """The Vibration about the equilibrium; raises InvalidTask where it is none."""
        system = self._system(self.mesh, self.held)
        q = self.mesh.unknowns(self.strains)
        residual = residual_of(system, evaluated(system, q))
        if residual > _AT_REST:
            raise InvalidTask(f'{self.name}: expected one in equilibrium, not in motion; at rest '
                              f'its residual would be {residual:.2g}')
        return _vibration(self.mesh, system, q)

    def resolving(self, n: int) -> Vibration:
        """Return a Vibration that resolves n modes: without a series of fewer than n terms.

        A series of N_c terms resolves N_c / 2 modes in each plane well.
        """
        mesh, known = self.mesh, self.vibration  # which looks whether it is at rest
        if mesh.basis == 'local' or n <= mesh.n_terms:
            return known
        return self._settled(mesh.local, self.strains) or known

    @cached_property
    def finer(self) -> Vibration | None:
        """The Vibration with every element halved and without the series; None: not found."""
        return self._settled(self.mesh.finer, np.repeat(self.strains, 2, axis=0))

    def _settled(self, mesh: Discretization, strains: Floats) -> Vibration | None:
        """Return the Vibration on another mesh, in equilibrium near strains (N, 3), or None."""
        found = minimum(mesh, self._system(mesh, mesh.past(self.before)), self.gripper,
                        mesh.unknowns(strains), None, Search(_MOST, False))
        if (found.residual > max(CONVERGED, 10 * self.residual)
                or found.violation > KEPT * mesh.s[-1]):
            return None
        return _vibration(mesh, found.system, found.state.q)

    def _system(self, mesh: Discretization, past: Memory) -> Problem:
        return mesh.system(self.gripper.rotation, self.gripper.position, past, self.holds)


@one_thread()
def _vibration(mesh: Discretization, system: Problem, q: Floats) -> Vibration:
    """Return the Vibration about the equilibrium of a Problem at q (m, 3)."""
    masses = np.maximum(node_masses(mesh.rod, mesh.s), 0.0)  # rounding may take more than all
    nodes = slice(0, None)
    if mesh.surroundings.pinned:
        system, q, nodes = with_hinge(system), hinge_unknowns(system, q), slice(1, None)
    # what has yielded springs back: vibrations are elastic
    system = system._replace(elastic=purely_elastic(), plastic=_without_springs(system.plastic))
    count = system.lengths.size + 1
    # springs of no strength, so that displacements are assembled too
    system = system._replace(anchor=InertiaTerm(np.zeros((count, 3)), np.zeros(count)))
    system, state, answers, hessian, _ = linearize(system, q)
    jacobian = _jacobian(system, hessian, state.positions)
    carried = node_twists(system, state, answers, 6)[:, 3:]
    border = hessian.border
    stiffness, strains = _stiffness(system, hessian), _strains(system)
    if border is not None and len(border.rows):
        free = scipy.linalg.null_space(border.rows.reshape(len(border.rows), q.size), _DEPENDENT)
        stiffness = free.T @ stiffness @ free
        jacobian, strains = jacobian @ free, strains @ free
    jacobian = jacobian[nodes]
    moved = (np.sqrt(masses)[:, None, None] * jacobian).reshape(-1, len(stiffness))
    return Vibration(stiffness, moved.T @ moved, jacobian, strains[nodes],
                     np.roll(carried[nodes], 3, axis=2), masses,
                     (system.lengths[:, None] * system.stiffness)[nodes])


def _without_springs(layers: PlasticSection | None) -> PlasticSection | None:
    return None if layers is None else layers._replace(share=np.zeros(0))


def _jacobian(system: Problem, hessian: Hessian, positions: Floats) -> Floats:
    """Return (N + 1, 3, 3 m): displacement of the nodes; positions (N + 1, 3) from the gripper."""
    turning, basis = hessian.twist_jacobian, system.basis
    n = len(turning)
    if basis.shape[1]:
        twists = np.einsum('iej,eki->ekji', basis, turning)
    else:
        twists = np.zeros((n, 6, n, 3))
        twists[np.arange(n), :, np.arange(n)] = turning
    twists = np.cumsum(twists.reshape(n, 6, -1), axis=0)  # of what lies beyond each element
    moved = np.zeros((n + 1, 3, twists.shape[2]))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moved[1:, i] = (twists[:, 3 + i] + twists[:, j] * positions[1:, k, None]
                        - twists[:, k] * positions[1:, j, None])
    return moved


def _stiffness(system: Problem, hessian: Hessian) -> Floats:
    """Return the symmetric Hessian (3 m, 3 m), of one unknown after the other."""
    if system.basis.shape[1]:
        return 0.5 * (hessian.dense + hessian.dense.T)
    n = len(hessian.twist_jacobian)
    product = (hessian.cross.reshape(3 * n, 6)
               @ hessian.twist_jacobian.transpose(1, 0, 2).reshape(6, 3 * n)).reshape(n, 3, n, 3)
    earlier = np.tri(n, k=-1)[:, None, :, None]  # cross_f turning_e holds for e < f
    lower = product * earlier
    lower[np.arange(n), :, np.arange(n)] = 0.5 * hessian.diagonal
    lower = lower.reshape(3 * n, 3 * n)
    return lower + lower.T


def _strains(system: Problem) -> Floats:
    """Return (N, 3, 3 m): change of the elements' strains by the unknowns."""
    n = system.lengths.size
    basis = system.basis if system.basis.shape[1] else np.tile(np.eye(n), (3, 1, 1))
    strains = np.zeros((n, 3, basis.shape[2], 3))
    for i in range(3):
        strains[:, i, :, i] = system.scale[:, i, None] * basis[i]
    return strains.reshape(n, 3, -1)


MOST_MODES = 1000       # modes that may be asked for
_TIE = 1e-10        # added to the stiffness: a motion without stiffness and mass is held by it
_NEUTRAL = 1e-2     # part of a mode's stiffness due to _TIE from which on the mode is neutral
_MASSLESS = 1e-11   # of the largest mu: a motion with less moves no mass
_STILL = 1e-9       # of the largest mass: as much may move in a motion that counts as massless
_SHOWN = 4          # frequencies in a repr


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Value):
    """The n slowest vibrations of a DLO about a shape at rest; N + 1 nodes, world axes, SI.

    A motion of the DLO is, while it is small, its quasi-static shape plus the sum over the modes of
    displacements[i] * y_i(t), and with the acceleration a (6,) of the gripper (displacement, then
    rotation about its origin)

        y_i'' + 2 damping_ratios[i] w_i y_i' + w_i^2 y_i = - participation[i] . a,
        w_i = 2 pi frequencies[i]

    Forces of damping due to the gripper's motion are neglected: a part of the order of the damping
    ratio.

    Attributes
    ----------
    s : ndarray, shape (N + 1,)
        Arc lengths of the nodes, m.
    masses : ndarray, shape (N + 1,)
        Masses of the nodes, kg.
    frequencies : ndarray, shape (n,)
        Frequencies in Hz, without damping; ascending, but not if they are followed along a path.
    damping_ratios : ndarray, shape (n,)
        Parts of the critical damping due to `Rod.damping`, to first order.
    displacements : ndarray, shape (n, N + 1, 3)
        Displacements of the nodes, m, for a generalized mass of 1 kg: the sum of mass times square
        over the nodes is 1.
    participation : ndarray, shape (n, 6)
        Participation in kg (kg m for rotations): the sum over the nodes of mass times the mode's
        displacement times the displacement of the node per slow motion of the gripper. The squares
        of the first three are effective masses in kg.
    overlap : ndarray, shape (n,) or None
        Likeness of each mode to the mode of the shape before that it continues (`modes_along`), 0
        to 1: the product of their displacements in the mass metric; 1 for a single shape.
    """

    s: Floats
    masses: Floats
    frequencies: Floats
    damping_ratios: Floats
    displacements: Floats
    participation: Floats
    overlap: Floats | None = None
    _estimate: Callable[[], Floats] | None = field(default=None, compare=False)

    _REMEMBERED = ('error_estimate',)

    def __post_init__(self) -> None:
        displacements = results('Modes.displacements', self.displacements, (None, None, 3))
        n, nodes, _ = displacements.shape
        overlap = np.ones(n) if self.overlap is None else self.overlap
        put(self, displacements=displacements, s=results('Modes.s', self.s, (nodes,)),
            masses=results('Modes.masses', self.masses, (nodes,)),
            frequencies=results('Modes.frequencies', self.frequencies, (n,)),
            damping_ratios=results('Modes.damping_ratios', self.damping_ratios, (n,)),
            participation=results('Modes.participation', self.participation, (n, 6)),
            overlap=results('Modes.overlap', overlap, (n,)))
        put(self, _estimate=estimate('Modes._estimate', self._estimate, n))
        super().__post_init__()

    def __repr__(self) -> str:
        known = ', '.join(f'{one:.4g}' for one in self.frequencies[:_SHOWN])
        more = ', ...' if len(self) > _SHOWN else ''
        return brief(self, f'{len(self)} modes', f'{known}{more} Hz' if known else '')

    def __len__(self) -> int:
        return self.frequencies.size

    @property
    def periods(self) -> Floats:
        """(n,) s, without damping."""
        return 1 / self.frequencies

    @cached_property
    def error_estimate(self) -> Floats:
        """(n,) estimated relative error of each frequency.

        From the modes of the DLO with every element halved and without its series, computed when
        this is first read; infinite if they are not found, nan for Modes made of numbers.
        """
        assert self._estimate is not None  # see __post_init__
        found = self._estimate()
        freeze(found)
        return found


def modes_of(linear: Linearized, n: int, spare: int = 0) -> Modes:
    """Return the n slowest Modes, from a Vibration that resolves `spare` more."""
    vibration = linear.resolving(n + spare)
    squares, found = solved(vibration, n, linear.name)
    return _modes(linear, vibration, squares, found, np.arange(squares.size))


def _modes(linear: Linearized, vibration: Vibration, squares: Floats, found: Floats,
           places: Ints, overlap: Floats | None = None) -> Modes:
    """Return the Modes that `solved` found; places, overlap (n,)."""
    rates = np.sqrt(squares)
    displacements = np.moveaxis(vibration.jacobian @ found, 2, 0)
    # the damping matrix: drag M + viscosity times the elastic stiffness alone, weight damps nothing
    damping: Any = linear.mesh.rod.damping
    drag, viscosity = damping
    viscous = np.einsum('ei,eim->m', vibration.resistance, (vibration.strains @ found) ** 2)
    participation = np.einsum('k,mki,kij->mj', vibration.masses, displacements, vibration.carried)
    return Modes(linear.mesh.s, vibration.masses, rates / (2 * np.pi),
                 (drag + viscosity * viscous) / (2 * rates), displacements, participation, overlap,
                 partial(_error, linear, rates, places))


@one_thread()
def solved(vibration: Vibration, n: int, name: str) -> tuple[Floats, Floats]:
    """Return (n,) squares of the angular frequencies, 1/s^2, ascending, and modes (c, n).

    Each mode has the generalized mass 1, and the largest component of its displacements is
    positive. There may be fewer than n.
    """
    size = len(vibration.mass)
    slowest = [max(size - n, 0), size - 1]
    tied = vibration.stiffness + _TIE * np.eye(size)
    try:
        mu, found = scipy.linalg.eigh(vibration.mass, tied, subset_by_index=slowest)
    except np.linalg.LinAlgError:
        mu, found = scipy.linalg.eigh(vibration.mass, _definite(vibration, name),
                                      subset_by_index=slowest)
    mu, found = mu[::-1], found[:, ::-1]
    moving = mu > _MASSLESS * mu.max(initial=0.0)
    mu, found = mu[moving], found[:, moving]
    if (_TIE * np.sum(found**2, axis=0) > _NEUTRAL).any():
        raise InvalidTask(f'{name}: expected a stable one, this one is neutral: it may move to '
                          'other places without a force')
    return 1 / mu, found * (_signs(vibration.jacobian @ found) / np.sqrt(mu))


def _definite(vibration: Vibration, name: str) -> Floats:
    """Return the stiffness, made positive for neutral motions that move no mass.

    An example is a round DLO between two joints, which may spin about its own axis.
    """
    values, vectors = np.linalg.eigh(vibration.stiffness)
    low = values < _TIE
    masses = np.sum(vectors * (vibration.mass @ vectors), axis=0)
    if (values < -HELD_NEUTRAL).any() or (masses[low] > _STILL * masses.max()).any():
        raise InvalidTask(f'{name}: expected a stable one, from which every motion takes energy')
    own: Floats = vectors[:, low]
    return vibration.stiffness + (own * (1.0 - values[low])) @ own.T


def _signs(displacements: Floats) -> Floats:
    """Return (n,) 1 or -1: signs of the largest displacements of n modes (N + 1, 3, n)."""
    nodes, _, count = displacements.shape
    flat = displacements.reshape(3 * nodes, count)
    return np.where(flat[np.abs(flat).argmax(axis=0), np.arange(count)] < 0, -1.0, 1.0)


def _error(linear: Linearized, rates: Floats, places: Ints) -> Floats:
    """Return (n,) relative errors of angular frequencies (n,): see `Modes.error_estimate`."""
    errors = np.full(rates.size, np.inf)
    finer = linear.finer
    if finer is not None and rates.size:
        true = np.full(int(places.max()) + 1, np.inf)
        squares, _ = solved(finer, true.size, 'shape')
        true[:squares.size] = np.sqrt(squares)
        errors = 4 / 3 * np.abs(true[places] / rates - 1)
    return errors


# ------------------------------------------------------------------------------------------------
# Modes along a path, matched by likeness: a mode stays itself where frequencies cross.


SPARE = 4      # more modes than asked for are computed: a followed one may have become faster
_EQUAL = 1e-6  # relative difference of squares of frequencies that count as one


def continued(before: Modes, linear: Linearized) -> Modes:
    """Return the Modes of a Linearized shape that continue the Modes `before`."""
    vibration = linear.resolving(len(before) + SPARE)
    squares, found = solved(vibration, len(before) + SPARE, linear.name)
    if squares.size < len(before):
        raise InvalidTask(f'{linear.name}: expected one with {len(before)} modes or more, as the '
                          f'one before, it has {squares.size}')
    weighted = _displacements_on(before, linear.mesh.s) * vibration.masses[:, None]
    like = np.einsum('mki,kic->mc', weighted, vibration.jacobian)  # products with the coordinates
    for one in _equal(squares):
        found[:, one] = _aligned(like, found[:, one])
    product = like @ found
    _, places = scipy.optimize.linear_sum_assignment(-np.abs(product))
    likeness = product[np.arange(len(before)), places]
    signs = np.where(likeness < 0, -1.0, 1.0)
    return _modes(linear, vibration, squares[places], found[:, places] * signs, places,
                  np.minimum(np.abs(likeness), 1.0))


def _displacements_on(modes: Modes, s: np.ndarray) -> np.ndarray:
    """Return (n, N + 1, 3) the displacements of Modes, m, on another mesh: nodes s (N + 1,), m.

    Linear between the nodes of the modes. A DLO of another length is scaled to this one.
    """
    if s.size == modes.s.size and (s == modes.s).all():
        return modes.displacements
    flat = np.moveaxis(modes.displacements, 1, 2).reshape(-1, modes.s.size)
    at = np.array([np.interp(s / s[-1], modes.s / modes.s[-1], one) for one in flat])
    return np.moveaxis(at.reshape(len(modes), 3, s.size), 2, 1)


def _equal(squares: Floats) -> Iterator[slice]:
    """Yield slices of ascending squares (n,) of frequencies that are equal."""
    ends = np.flatnonzero(np.diff(squares) > _EQUAL * squares[1:]) + 1
    for begin, end in zip([0, *ends], [*ends, squares.size], strict=True):
        if end - begin > 1:
            yield slice(begin, end)


def _aligned(like: Floats, found: Floats) -> Floats:
    """Return modes (c, g) of equal frequency, combined to be most like g modes before.

    Orthogonal Procrustes: Golub and Van Loan, Matrix Computations, ch. 6.4.

    Shapes: like (n, c).
    """
    product = like @ found
    nearest = np.sort(np.argsort(-np.sum(product**2, axis=1), kind='stable')[:found.shape[1]])
    left, _, right = np.linalg.svd(product[nearest], full_matrices=True)
    count = len(nearest)
    turn = right.T.copy()
    turn[:, :count] = right[:count].T @ left.T
    result: Floats = found @ turn
    return result
