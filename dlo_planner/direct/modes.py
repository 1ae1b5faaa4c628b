"""How a hanging DLO vibrates: natural frequencies, damping and mode shapes about a shape at rest.

The mass matrix is singular, because torsion of a straight DLO moves no mass, so what is solved is
M x = mu K x with mu = 1 / omega^2; K is positive definite at a stable shape.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from scipy.linalg import LinAlgError, eigh

from dlo_planner.direct.vibration import Linearized
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.held import HELD_NEUTRAL
from dlo_planner.model.checks import integer, results, shown
from dlo_planner.model.value import Constant, Value, brief, freeze, put

MOST = 1000         # modes that may be asked for
_TIE = 1e-10        # added to the stiffness: what has neither stiffness nor mass stays where it is
_NEUTRAL = 1e-2     # part of a mode's stiffness which that adds: such a mode has none of its own
_MASSLESS = 1e-11   # of the largest: mu of what moves no mass
_STILL = 1e-9       # of the largest: mass of such a motion
_SHOWN = 4


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Value):
    """The n slowest vibrations of a DLO about a shape at rest; N + 1 nodes, world axes, SI.

    A motion of the DLO is, while it is small, its quasi-static shape plus the sum over the modes of
    displacements[i] * y_i(t), and with the acceleration a (6,) of the gripper (displacement, then
    rotation about its origin)

        y_i'' + 2 damping_ratios[i] w_i y_i' + w_i^2 y_i = - participation[i] . a,
        w_i = 2 pi frequencies[i]

    but for what damping itself does as the gripper moves: a part of the order of the damping ratio.

    Attributes:
        s: (N + 1,) arc lengths of the nodes, m
        masses: (N + 1,) of the nodes, kg
        frequencies: (n,) Hz, without damping; ascending, unless they are followed along a path
        damping_ratios: (n,) parts of the critical damping, by `Rod.damping`; to first order in it
        displacements: (n, N + 1, 3) of the nodes, m, for a generalized mass of 1 kg: the sum over
            the nodes of mass times square is 1
        participation: (n, 6) kg (kg m for rotations): the sum over the nodes of mass times
            displacement times that of a slowly moved gripper's DLO; its square, with displacements,
            is the effective mass
        overlap: (n,) how alike each mode is to that of the shape before which it continues
            (`modes_along`), 0 to 1: the product of their displacements in the mass metric
    """

    s: np.ndarray
    masses: np.ndarray
    frequencies: np.ndarray
    damping_ratios: np.ndarray
    displacements: np.ndarray
    participation: np.ndarray
    overlap: np.ndarray | None = None
    _estimate: Callable | None = field(default=None, compare=False)

    REMEMBERED = ('error_estimate',)

    def __post_init__(self):
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

    def __repr__(self):
        known = ', '.join(f'{one:.4g}' for one in self.frequencies[:_SHOWN])
        more = ', ...' if len(self) > _SHOWN else ''
        return brief(self, f'{len(self)} modes', f'{known}{more} Hz' if known else '')

    def __len__(self):
        return self.frequencies.size

    @property
    def periods(self) -> np.ndarray:
        """(n,) s, without damping."""
        return 1 / self.frequencies

    @cached_property
    def error_estimate(self) -> np.ndarray:
        """(n,) how far, as a part of it, each frequency is from the true rod's.

        From the modes of the DLO with every element halved and freed from its series, found when
        this is first read; infinite where they are not, nan for Modes that were made of numbers.
        """
        found = self._estimate()
        freeze(found)
        return found


def modes_of(shape, n):
    """Return the Modes of a Shape; see `Shape.modes`."""
    n, linear = integer('n', n, minimum=1, maximum=MOST), Linearized(shape)
    vibration = linear.resolving(n)
    squares, found = solved(vibration, n, 'shape')
    return modes_from(linear, vibration, squares, found, np.arange(squares.size))


def modes_from(linear, vibration, squares, found, places, overlap=None):
    """Return the Modes of what was `solved` about a Linearized shape.

    Args:
        vibration: Vibration about it, on its own mesh
        squares: (n,) 1/s^2; found: (c, n); overlap: (n,)
        places: (n,) how many modes of this DLO are slower than each
    """
    shape = linear.shape
    rates = np.sqrt(squares)
    displacements = np.moveaxis(vibration.jacobian @ found, 2, 0)
    # the damping matrix: drag M + viscosity times the elastic stiffness alone, weight damps nothing
    drag, viscosity = shape.rod.damping
    viscous = np.einsum('ei,eim->m', vibration.resistance, (vibration.strains @ found) ** 2)
    participation = np.einsum('k,mki,kij->mj', vibration.masses, displacements, vibration.carried)
    return Modes(shape.s, vibration.masses, rates / (2 * np.pi),
                 (drag + viscosity * viscous) / (2 * rates), displacements, participation, overlap,
                 partial(_error, linear, rates, places))


def solved(vibration, n, name):
    """Return (n,) squares of the angular frequencies, 1/s^2, ascending, and modes (c, n).

    Each mode has the generalized mass 1, and the largest of its displacements is positive. There
    may be fewer than n.

    Args:
        name: of the shape, for messages

    Raises:
        InvalidTask: the shape is not stable
    """
    size = len(vibration.mass)
    slowest = [max(size - n, 0), size - 1]
    tied = vibration.stiffness + _TIE * np.eye(size)
    try:
        mu, found = eigh(vibration.mass, tied, subset_by_index=slowest)
    except LinAlgError:
        mu, found = eigh(vibration.mass, _definite(vibration, name), subset_by_index=slowest)
    mu, found = mu[::-1], found[:, ::-1]
    moving = mu > _MASSLESS * mu.max(initial=0.0)
    mu, found = mu[moving], found[:, moving]
    if (_TIE * np.sum(found**2, axis=0) > _NEUTRAL).any():
        raise InvalidTask(f'{name}: expected a stable one, this one is neutral: it may move to '
                          'other places without a force')
    return 1 / mu, found * (_signs(vibration.jacobian @ found) / np.sqrt(mu))


def _definite(vibration, name):
    """Return the stiffness, made positive where it is neutral and moves no mass.

    As a round DLO between two joints is, which may spin about its own axis.

    Raises:
        InvalidTask: it is not positive elsewhere
    """
    values, vectors = np.linalg.eigh(vibration.stiffness)
    low = values < _TIE
    masses = np.sum(vectors * (vibration.mass @ vectors), axis=0)
    if (values < -HELD_NEUTRAL).any() or (masses[low] > _STILL * masses.max()).any():
        raise InvalidTask(f'{name}: expected a stable one, from which every motion takes energy')
    return vibration.stiffness + (vectors[:, low] * (1.0 - values[low])) @ vectors[:, low].T


def _signs(displacements):
    """Return (n,) 1 or -1: of the largest of each mode's displacements (N + 1, 3, n)."""
    flat = displacements.reshape(-1, displacements.shape[2])
    return np.where(flat[np.abs(flat).argmax(axis=0), np.arange(flat.shape[1])] < 0, -1.0, 1.0)


def _error(linear, rates, places):
    """Return (n,) relative errors of angular frequencies (n,): see `Modes.error_estimate`."""
    errors = np.full(rates.size, np.inf)
    finer = linear.finer
    if finer is not None and rates.size:
        true = np.full(int(places.max()) + 1, np.inf)
        squares, _ = solved(finer, true.size, 'shape')
        true[:squares.size] = np.sqrt(squares)
        errors = 4 / 3 * np.abs(true[places] / rates - 1)
    return errors
