# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Vibrations of a DLO: natural frequencies, damping and mode shapes about a shape at rest.

Torsion of a straight DLO moves no mass, so the mass matrix M is singular. The eigenvalue problem is
therefore M x = mu K x with mu = 1 / omega^2; K is positive definite at a stable shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from dlo_planner.direct.vibration import Linearized, Vibration
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.held import HELD_NEUTRAL
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import integer, shown
from dlo_planner.model.computed import results
from dlo_planner.model.value import Constant, Value, brief, freeze, put

if TYPE_CHECKING:  # it imports this module
    from dlo_planner.direct.shape import Shape

MOST = 1000         # modes that may be asked for
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

    REMEMBERED = ('error_estimate',)

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
        if self._estimate is None:
            put(self, _estimate=Constant(np.full(n, np.nan)))
        if not callable(self._estimate):
            raise InvalidTask(f'Modes._estimate = {shown(self._estimate)}: expected a function')
        if isinstance(self._estimate, Constant):
            freeze(self._estimate.content)
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


def modes_of(shape: Shape, n: int) -> Modes:
    """Return the Modes of a Shape; see `Shape.modes`."""
    n, linear = integer('n', n, minimum=1, maximum=MOST), Linearized(shape)
    vibration = linear.resolving(n)
    squares, found = solved(vibration, n, 'shape')
    return modes_from(linear, vibration, squares, found, np.arange(squares.size))


def modes_from(linear: Linearized, vibration: Vibration, squares: Floats, found: Floats,
               places: Ints, overlap: Floats | None = None) -> Modes:
    """Return the Modes that `solved` found about a Linearized shape.

    Parameters
    ----------
    linear : Linearized
        Linearized shape.
    vibration : Vibration
        Vibration about it, with the nodes of its own mesh.
    squares : ndarray, shape (n,)
        Squares of the angular frequencies, 1/s^2.
    found : ndarray, shape (c, n)
    overlap : ndarray, shape (n,), optional
    places : ndarray, shape (n,)
        How many modes of this DLO are slower than each.
    """
    shape = linear.shape
    rates = np.sqrt(squares)
    displacements = np.moveaxis(vibration.jacobian @ found, 2, 0)
    # the damping matrix: drag M + viscosity times the elastic stiffness alone, weight damps nothing
    damping: Any = shape.state.made_on.rod.damping
    drag, viscosity = damping
    viscous = np.einsum('ei,eim->m', vibration.resistance, (vibration.strains @ found) ** 2)
    participation = np.einsum('k,mki,kij->mj', vibration.masses, displacements, vibration.carried)
    return Modes(shape.s, vibration.masses, rates / (2 * np.pi),
                 (drag + viscosity * viscous) / (2 * rates), displacements, participation, overlap,
                 partial(_error, linear, rates, places))


def solved(vibration: Vibration, n: int, name: str) -> tuple[Floats, Floats]:
    """Return (n,) squares of the angular frequencies, 1/s^2, ascending, and modes (c, n).

    Each mode has the generalized mass 1, and the largest component of its displacements is
    positive. There may be fewer than n.

    Parameters
    ----------
    vibration : Vibration
    n : int
        Number of modes.
    name : str
        Name of the shape, for messages.

    Raises
    ------
    InvalidTask
        The shape is not stable.
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

    Raises
    ------
    InvalidTask
        It is not a positive number.
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
    flat = displacements.reshape(-1, displacements.shape[2])
    return np.where(flat[np.abs(flat).argmax(axis=0), np.arange(flat.shape[1])] < 0, -1.0, 1.0)


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
