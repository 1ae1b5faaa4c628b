"""How a DLO vibrates while its gripper goes along a leg by a time law u(t).

With the gripper at rest at the parameter u the DLO would hang in the equilibrium X(u). Its
deviation from X(u) is a sum of modes, displacement_i(u) y_i(t), with

    y_i'' + 2 zeta_i w_i y_i' + w_i^2 y_i = -(slope_i(u) u'' + bend_i(u) u'^2),

where slope_i and bend_i are the products, weighted by mass, of the mode with dX/du and d^2X/du^2.
Frequencies and modes change along the leg. Where two frequencies come close, the modes turn into
one another, and the coordinates y turn with them. Such a prediction takes milliseconds; the
trajectory that rests on it is verified by `DirectSimulator.simulate`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from dlo_planner.direct.mode_tracking import displacements_on, modes_along
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.loads import node_masses
from dlo_planner.inverse.fastest import Bearing
from dlo_planner.inverse.oscillators import vibrated
from dlo_planner.inverse.path import Leg
from dlo_planner.inverse.time_law import TimeLaw
from dlo_planner.model.pose import Pose

_PLACES = 17      # parameters of a leg, at least, at which modes are computed
_MODES = 5
# between two places the slowest modes' frequencies change by no more than this part, unless the
# halvings are used up
_SLOWEST, _CHANGE, _HALVINGS = 2, 0.06, 5
_PER_PERIOD = 60  # instants in the slowest period; a step is exact for a steady force
_FEWEST, _MOST = 200, 20_000  # instants


@dataclass(frozen=True)
class Response:
    """What is known of a DLO at n parameters of a leg; m modes, N + 1 nodes.

    Attributes:
        parameters: (n,)
        shapes: n Shape
        rates: (n, m) angular frequencies, 1/s; damping: (n, m) ratios
        displacements: (n, m, N + 1, 3) m, of generalized mass 1 kg
        slopes, bends: (n, m), as in the equation at the top of this module
        pulls: (n, m, 3) the same products with a unit displacement of the whole DLO along x, y, z
        turning: (n - 1, m, m) skew: rate by u at which the modes turn into one another between
            two parameters
    """

    parameters: np.ndarray
    shapes: tuple
    rates: np.ndarray
    damping: np.ndarray
    displacements: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray
    pulls: np.ndarray
    turning: np.ndarray

    @classmethod
    def of(cls, simulator: DirectSimulator, leg: Leg, first: Shape) -> 'Response':
        """Return the Response on a Leg at whose beginning the DLO has the Shape `first`.

        Raises:
            InvalidTask: a shape on the leg has no modes
        """
        u, shapes, modes = _places(simulator, leg, first)
        s = shapes[0].s
        positions = CubicSpline(u, np.array([_on(shape, s) for shape in shapes]))
        masses = node_masses(simulator.rod, s)
        displacements = np.array([displacements_on(one, s) for one in modes])
        slopes, bends = (np.einsum('k,umki,uki->um', masses, displacements, positions(u, order))
                         for order in (1, 2))
        return cls(u, tuple(shapes), 2 * np.pi * np.array([one.frequencies for one in modes]),
                   np.array([one.damping_ratios for one in modes]), displacements, slopes, bends,
                   np.einsum('k,umki->umi', masses, displacements),
                   _turning(masses, displacements) / np.diff(u)[:, None, None])

    @property
    def sizes(self) -> np.ndarray:
        """(n, m) largest displacement of a node by a mode, m."""
        return np.linalg.norm(self.displacements, axis=3).max(axis=2)

    def bearing(self, deviation: float, sizes: np.ndarray) -> Bearing:
        """Return the Bearing that bounds the quasi-static deviation of each mode.

        That is the deviation |slope u'' + bend u'^2| / w^2 which builds up under a steady force.

        Args:
            deviation: the bound, m
            sizes: (n, m) of the displacements that count, m
        """
        stiff = sizes / self.rates**2
        return Bearing(self.parameters, self.slopes * stiff, self.bends * stiff,
                       np.full(self.slopes.shape, deviation))

    def oscillators(self, law: TimeLaw, off: float = 1.0) -> tuple[np.ndarray, ...]:
        """Return times (t + 1,), parameters (t + 1,), rates and damping (t, m), turns (t, m, m).

        Times in s, rates in 1/s. The last three are the arguments of `vibrated`.

        Args:
            law: TimeLaw
            off: factor of all frequencies, as if the DLO were stiffer or softer
        """
        periods = law.duration * self.rates.min() / (2 * np.pi)
        count = int(np.clip(periods * _PER_PERIOD, _FEWEST, _MOST))
        times = np.linspace(0, law.duration, count + 1)
        u, middle = (law.at(at)[0] for at in (times, 0.5 * (times[1:] + times[:-1])))
        place = np.clip(np.searchsorted(self.parameters, middle) - 1, 0, len(self.turning) - 1)
        half = 0.5 * np.diff(u)[:, None, None] * self.turning[place]
        one = np.eye(half.shape[1])
        return (times, u, off * self.between(self.rates, middle),
                self.between(self.damping, middle), np.linalg.solve(one + half, one - half))

    def excited(self, law: TimeLaw, off: float = 1.0) -> tuple[np.ndarray, ...]:
        """Return times (t,) s, parameters (t,), and y and y'/w (2, t, m) that a TimeLaw excites.

        Args:
            law: TimeLaw; its shift counts
            off: factor of all frequencies
        """
        times, u, *oscillators = self.oscillators(law, off)
        middle = 0.5 * (times[1:] + times[:-1])
        places, rate, change, _ = law.at(middle)
        force = -(self.between(self.slopes, places) * change[:, None]
                  + self.between(self.bends, places) * (rate**2)[:, None])
        if law.shift is not None:
            force -= np.einsum('tmi,ti->tm', self.between(self.pulls, places),
                               law.shift.at(middle, 2))
        return times, u, vibrated(times[1], *oscillators, force[None])[:, 0]

    def between(self, known: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return (t, ...) at u (t,): linear between the values `known` (n, ...) at `parameters`."""
        n = self.parameters
        after = np.clip(np.searchsorted(n, u), 1, n.size - 1)
        share = np.clip((u - n[after - 1]) / (n[after] - n[after - 1]), 0, 1)
        share = share.reshape(-1, *np.ones(known.ndim - 1, dtype=int))
        return (1 - share) * known[after - 1] + share * known[after]

    def sideways(self, s: np.ndarray) -> np.ndarray:
        """Return (n, m, 3) the displacements at arc lengths s (n,), m, across the DLO there, m."""
        out = np.empty((*self.slopes.shape, 3))
        for k, shape in enumerate(self.shapes):
            along = shape.frame_at(float(s[k]))[0][:, 0]
            nodes = self.shapes[0].s
            moved = np.array([[np.interp(s[k], nodes, column) for column in one.T]
                              for one in self.displacements[k]])
            out[k] = moved - (moved @ along)[:, None] * along
        return out


def _places(simulator, leg, first):
    """Return parameters (n,), n Shapes and n Modes on a leg, denser where frequencies change fast.

    Where they do, as near a loss of stability, shapes and modes change fast as well.
    """
    parts = max(1, -(-(_PLACES - 1) // (leg.knots.size - 1)))
    u = np.append(leg.pieces(parts)[0], leg.knots[-1])
    for left in reversed(range(_HALVINGS)):
        poses = [Pose.from_rotation(*pose) for pose in zip(*leg.poses(u), strict=True)]
        shapes = simulator.track(poses, initial=first)
        modes = modes_along(shapes, _MODES)
        rates = np.array([one.frequencies[:_SLOWEST] for one in modes])
        change = np.abs(np.diff(rates, axis=0))
        far = (change > _CHANGE * np.maximum(rates[1:], rates[:-1])).any(axis=1)
        if not (left and far.any()):
            return u, shapes, modes
        u = np.sort(np.append(u, 0.5 * (u[:-1] + u[1:])[far]))


def _on(shape, s):
    """Return (N + 1, 3) the positions of a Shape at arc lengths s (N + 1,)."""
    if np.array_equal(shape.s, s):
        return shape.positions
    return np.array([shape.at(float(one)).position for one in s])


def _turning(masses, displacements):
    """Return (n - 1, m, m) skew matrices: by how much modes turn from one place to the next.

    The rotation nearest to the products, weighted by mass, of the modes at both places.
    """
    products = np.einsum('k,umki,uvki->umv', masses, displacements[:-1], displacements[1:])
    left, _, right = np.linalg.svd(products)
    turn = left @ right  # = (1 + A/2)^-1 (1 - A/2) of the skew A that is wanted (Cayley)
    one = np.eye(turn.shape[1])
    skew = 2 * np.linalg.solve(one + np.swapaxes(turn, 1, 2), one - np.swapaxes(turn, 1, 2))
    return 0.5 * (skew - np.swapaxes(skew, 1, 2))
