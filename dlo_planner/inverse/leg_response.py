"""How a DLO answers when its gripper goes along a leg: its vibrations, excited by the time law.

While the gripper is at the parameter u the DLO would hang in the equilibrium X(u). Its deviation
from it is a sum of modes, displacement_i(u) y_i(t), with

    y_i'' + 2 zeta_i w_i y_i' + w_i^2 y_i = -(slope_i(u) u'' + bend_i(u) u'^2),

slope_i and bend_i the products, weighted by mass, of the mode with dX/du and d^2X/du^2. That modes
change along the way is in w_i, zeta_i, slope_i and bend_i, not in further forces: they change
slowly. A time law is judged with it in microseconds; what it promises is verified by
`DirectSimulator.simulate`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from dlo_planner.direct.mode_tracking import modes_along
from dlo_planner.energy.loads import node_masses
from dlo_planner.inverse.fastest import Bearing
from dlo_planner.inverse.oscillators import vibrated
from dlo_planner.model.pose import Pose

_PLACES = 17      # on a leg, at least, where modes are known
_MODES = 6
_PER_PERIOD = 24  # instants in the shortest period looked at
_SHORTEST = 0.05  # s: a period that is not looked at, its mode follows slowly
_MOST = 40_000    # instants


@dataclass(frozen=True)
class Response:
    """What is known of a DLO at n parameters of a leg; m modes, N + 1 nodes.

    Attributes:
        parameters: (n,)
        shapes: n Shape
        rates: (n, m) angular frequencies, 1/s; damping: (n, m) ratios
        displacements: (n, m, N + 1, 3) m, of generalized mass 1 kg
        slopes, bends: (n, m), see above
        pulls: (n, m, 3) the same products with a shift of the gripper, of the DLO as it is
    """

    parameters: np.ndarray
    shapes: tuple
    rates: np.ndarray
    damping: np.ndarray
    displacements: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray
    pulls: np.ndarray

    @classmethod
    def of(cls, simulator, leg, first):
        """Return the Response on a Leg that begins in the Shape `first`.

        Args:
            simulator: DirectSimulator

        Raises:
            InvalidTask: a shape on the way has no modes
        """
        parts = max(1, -(-(_PLACES - 1) // (leg.knots.size - 1)))
        u = np.append(leg.pieces(parts)[0], leg.knots[-1])
        shapes = simulator.track([Pose.from_rotation(*pose) for pose in zip(*leg.poses(u),
                                                                            strict=True)],
                                 initial=first)
        modes = modes_along(shapes, _MODES)
        s = shapes[0].s
        positions = CubicSpline(u, np.array([_on(shape, s) for shape in shapes]))
        masses = node_masses(simulator.rod, s)
        displacements = np.array([_spread(one, s) for one in modes])
        slopes, bends = (np.einsum('k,umki,uki->um', masses, displacements, positions(u, order))
                         for order in (1, 2))
        return cls(u, tuple(shapes), 2 * np.pi * np.array([one.frequencies for one in modes]),
                   np.array([one.damping_ratios for one in modes]), displacements, slopes, bends,
                   np.einsum('k,umki->umi', masses, displacements))

    @property
    def sizes(self):
        """(n, m) largest displacement of a node by a mode, m."""
        return np.linalg.norm(self.displacements, axis=3).max(axis=2)

    def bearing(self, deviation, sizes):
        """Return the Bearing that keeps the slowly built-up deviation of each mode below, m.

        Args:
            sizes: (n, m) of the displacements that count, m
        """
        stiff = sizes / self.rates**2
        return Bearing(self.parameters, self.slopes * stiff, self.bends * stiff,
                       np.full(self.slopes.shape, deviation))

    def oscillators(self, law, off=1.0):
        """Return times (t + 1,), parameters (t + 1,), and in between rates and damping (t, m).

        Args:
            law: TimeLaw
            off: factor of all frequencies, as if the DLO was stiffer or softer
        """
        fastest = min(off * self.rates.max(), 2 * np.pi / _SHORTEST)
        count = int(np.clip(law.duration * fastest / (2 * np.pi) * _PER_PERIOD, 200, _MOST))
        times = np.linspace(0, law.duration, count + 1)
        u = law.at(0.5 * (times[1:] + times[:-1]))[0]
        return (times, law.at(times)[0], off * self.between(self.rates, u),
                self.between(self.damping, u))

    def excited(self, law, off=1.0):
        """Return what a TimeLaw does at t instants: times, parameters (t,), y and y'/w (2, t, m).

        Args:
            law: TimeLaw, with its shift
            off: factor of all frequencies
        """
        times, u, rates, damping = self.oscillators(law, off)
        middle = 0.5 * (times[1:] + times[:-1])
        places, rate, change, _ = law.at(middle)
        force = -(self.between(self.slopes, places) * change[:, None]
                  + self.between(self.bends, places) * (rate**2)[:, None])
        if law.shift is not None:
            force -= np.einsum('tmi,ti->tm', self.between(self.pulls, places),
                               law.shift.at(middle, 2))
        return times, u, vibrated(times[1], rates, damping, force)

    def between(self, known, u):
        """Return what is `known` (n, ...) at the parameters, at others u (t,)."""
        n = self.parameters
        after = np.clip(np.searchsorted(n, u), 1, n.size - 1)
        share = np.clip((u - n[after - 1]) / (n[after] - n[after - 1]), 0, 1)
        share = share.reshape(-1, *np.ones(known.ndim - 1, dtype=int))
        return (1 - share) * known[after - 1] + share * known[after]

    def sideways(self, s):
        """Return (n, m, 3) the displacements at arc lengths s (n,), across the DLO there, m."""
        out = np.empty((*self.slopes.shape, 3))
        for k, shape in enumerate(self.shapes):
            along = shape.frame_at(float(s[k]))[0][:, 0]
            nodes = self.shapes[0].s
            moved = np.array([[np.interp(s[k], nodes, column) for column in one.T]
                              for one in self.displacements[k]])
            out[k] = moved - (moved @ along)[:, None] * along
        return out


def _on(shape, s):
    """Return (N + 1, 3) the positions of a Shape at arc lengths s (N + 1,)."""
    if np.array_equal(shape.s, s):
        return shape.positions
    return np.array([shape.at(float(one)).position for one in s])


def _spread(modes, s):
    """Return the displacements of Modes at arc lengths s."""
    if np.array_equal(modes.s, s):
        return modes.displacements
    flat = np.moveaxis(modes.displacements, 2, 1).reshape(-1, modes.s.size)
    at = np.array([np.interp(s, modes.s, one) for one in flat])
    return np.moveaxis(at.reshape(len(modes), 3, s.size), 1, 2)
