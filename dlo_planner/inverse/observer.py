"""An estimate of a DLO from looks at it, at rest or moving calmly.

Iterated extended Kalman filter in information form (Bell and Cathey 1993: each update is a
Gauss-Newton search for the most likely state). Between looks the state stays, or wanders by
`drift`. The model: a look shows the equilibrium in the gripper as it is, plus a sway of the free
end that is another one in each look, plus noise of each point.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.indicator import surely_within
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.estimate import Estimate
from dlo_planner.inverse.looking import from_either_end, looked_at
from dlo_planner.inverse.observation import Observation
from dlo_planner.inverse.response import node_slopes
from dlo_planner.inverse.settling import settled
from dlo_planner.inverse.tolerance import Spread
from dlo_planner.inverse.uncertain import Uncertain
from dlo_planner.model.checks import instance, integer, number, vector
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, put

_ITERATIONS = 25
_HALVINGS = 6
_SETTLED = 1e-3   # mean square of a step in standard deviations of what is known: the last one
_STEADY = 1.05    # ratio of two scales of what is left that are the same
_LONGER = 5.0     # standard deviations of the length by which an arc length may exceed it
_FARTHEST = 0.15  # of the length: by which one step may move a node


class Observer(Value):
    """Turns looks at a DLO into an `Estimate` of it; a value, what is known is in the Estimates.

    Args:
        simulator: DirectSimulator of the DLO as stated, or its Rod. It hangs freely: obstacles are
            left out, and it does not yield.
        spread: Spread of the DLO and of the gripper's pose about what is stated: the prior
        noise: standard deviation of a seen point along each axis, m
        bias: of the camera's constant error along each world axis, m
        cutout: of the place of the cut-out along each world axis about where it is stated, m
        outliers: part of the points that are none of the DLO's, 0 to below 1
        sway: of the free end about its equilibrium, m, along each world axis, another one in each
            look; the DLO between goes by (s / L)^2. It averages out over a period of the swing.
        drift: how the state wanders: its standard deviation after 1 s, as part of the prior's
        n_terms: Legendre terms along s of each component of the natural curvature

    Raises:
        InvalidTask: an argument makes no sense; the message names it
    """

    PARTS = ('uncertain', 'noise', 'outliers', 'sway', 'drift')

    def __init__(self, simulator: DirectSimulator | Rod, spread: Spread, *, noise: float = 1e-3,
                 bias: float = 0.0, cutout: float = 0.0, outliers: float = 0.1, sway: float = 0.0,
                 drift: float = 0.0, n_terms: int = 6):
        if isinstance(simulator, Rod):
            simulator = DirectSimulator(simulator)
        simulator = clamping('simulator', simulator)
        if simulator.surroundings.has_moments:
            raise InvalidTask('simulator.point_loads: expected forces alone, dead moments have no '
                              'potential')
        instance('spread', spread, Spread)
        uncertain = Uncertain(simulator.elastic().without_obstacles(), spread,
                              integer('n_terms', n_terms, minimum=1, maximum=20),
                              number('bias', bias, minimum=0), number('cutout', cutout, minimum=0))
        if not uncertain.size:
            raise InvalidTask(f'spread = {spread!r}: expected something that is uncertain')
        put(self, uncertain=uncertain, noise=number('noise', noise, above=0),
            outliers=number('outliers', outliers, minimum=0, below=1),
            sway=number('sway', sway, minimum=0), drift=number('drift', drift, minimum=0))
        super().__post_init__()

    def begin(self) -> Estimate:
        """Return the Estimate before any look: the prior."""
        return Estimate(self.uncertain, np.zeros(self.uncertain.size),
                        np.diag(self.uncertain.deviations**2))

    def update(self, estimate: Estimate, observation: Observation, *,
               elapsed: float = 0.0) -> Estimate:
        """Return the Estimate after one more look.

        Args:
            estimate: of this observer
            observation: Observation, its gripper as it is said to have been when the points were
                seen (`gripper_at` tells it from stamped poses). Points in any order; arc lengths,
                if known, from either end, all from the same.
            elapsed: s since the look before; the state has wandered by `drift`

        A look that cannot be explained by an equilibrium leaves the estimate as it is, but for
        `converged`, which is False then.

        Raises:
            InvalidTask: an argument makes no sense
        """
        self._own(estimate)
        elapsed = number('elapsed', elapsed, minimum=0)
        if instance('observation', observation, Observation).far_end is not None:
            raise InvalidTask('observation.far_end: expected None, the DLO hangs freely')
        length = self.uncertain.simulator.rod.length + _LONGER * self.uncertain.spread.length
        if observation.s is not None and ((observation.s < 0) | (observation.s > length)).any():
            raise InvalidTask(f'observation.s: expected 0 to the length {length:g} m')
        search = _Search(self, estimate, observation,
                         self._wandered(estimate.covariance, elapsed))
        found = search.found()
        return replace(estimate, converged=False) if found is None else found

    def see_cutout(self, estimate: Estimate, stated: ArrayLike, seen: ArrayLike,
                   noise: float | None = None) -> Estimate:
        """Return the Estimate after the centre of the cut-out has been seen by the same camera.

        What the camera sees displaced alike, DLO and cut-out, then cancels.

        Args:
            estimate: of this observer
            stated: (3,) centre of the cut-out as it is stated, m; seen: (3,) as it was seen
            noise: standard deviation of `seen` along each axis, m; None: the observer's noise

        Raises:
            InvalidTask: an argument makes no sense, or the cut-out's place is not uncertain
        """
        self._own(estimate)
        off = vector('seen', seen, 3) - vector('stated', stated, 3)
        noise = self.noise if noise is None else number('noise', noise, above=0)
        if not self.uncertain.cutout:
            raise InvalidTask('cutout = 0: expected an observer that takes the cut-out\'s place as '
                              'uncertain')
        rows = np.zeros((3, self.uncertain.size))
        for name in ('camera', 'cutout'):
            columns, number_ = self.uncertain.columns(name)
            rows[number_, columns] = 1.0
        covariance = estimate.covariance
        gain = np.linalg.solve(rows @ covariance @ rows.T + noise**2 * np.eye(3),
                               rows @ covariance).T
        return replace(estimate, mean=estimate.mean + gain @ (off - rows @ estimate.mean),
                       covariance=_symmetric(covariance - gain @ rows @ covariance))

    def _own(self, estimate):
        if instance('estimate', estimate, Estimate).uncertain != self.uncertain:
            raise InvalidTask('estimate: expected one of this observer')

    def _wandered(self, covariance, elapsed):
        return covariance + elapsed * np.diag((self.drift * self.uncertain.deviations) ** 2)


class _Search:
    """The most likely state after a look, by Gauss and Newton's method.

    The unknowns are in standard deviations of the prior; behind them the sway, in its own.
    """

    def __init__(self, observer, estimate, observation, covariance):
        self._observer, self._estimate, self._seen = observer, estimate, observation
        uncertain = observer.uncertain
        self._uncertain, n = uncertain, uncertain.size
        self._swaying = 3 if observer.sway else 0
        self._unit = np.append(uncertain.deviations, np.full(self._swaying, observer.sway))
        self._before = np.append(estimate.mean, np.zeros(self._swaying)) / self._unit
        self._information = np.eye(n + self._swaying)
        self._information[:n, :n] = np.linalg.inv(
            covariance / np.outer(uncertain.deviations, uncertain.deviations))
        self._s = observation.s

    def found(self):
        """Return the Estimate, or None."""
        x, last, scale = self._before.copy(), np.inf, np.inf
        shape = self._first()
        for _ in range(_ITERATIONS):
            if not shape.converged:
                return None
            look, slopes = self._look(x, shape)
            scale = look.scale(self._observer.noise)
            weights = look.weights(scale, self._observer.outliers, shape.s[-1])
            step, information = self._step(x, look, weights, scale)
            moved = float(step @ information @ step) / step.size
            x, shape, whole = self._moved(x, step, shape, slopes)
            if whole and moved < _SETTLED and last <= _STEADY * scale:
                return self._result(x, shape, information, look, weights)
            last = scale
        return None

    def _first(self):
        """Return the Shape in the gripper of this look, at the state before it."""
        observer, estimate = self._observer, self._estimate
        simulator, known = self._uncertain.simulator, estimate._shape
        gripper = estimate.actual(self._seen.gripper)
        good = known is not None and (simulator.accuracy is None
                                      or surely_within(known, simulator.accuracy))
        mesh = known._discretisation if good else simulator.discretisation(gripper, None)
        self._varied = observer.uncertain.varied(mesh)
        return settled(self._varied, estimate.mean, gripper, known)

    def _look(self, x, shape):
        """Return the Look at unknowns x, and the slopes of the nodes by the state."""
        z, sway = self._parts(x)
        slopes = node_slopes(self._varied, z, shape)
        points = self._seen.points - self._uncertain.camera(z)
        if self._s is not None and self._s is self._seen.s:
            self._s = from_either_end(shape, points, self._s)
        seen = slopes.copy()
        columns, numbers = self._uncertain.columns('camera')
        seen[:, numbers, columns] += 1.0
        return looked_at(shape, seen, points, self._s, sway), slopes

    def _parts(self, x):
        z = x * self._unit
        n = self._uncertain.size
        return z[:n], z[n:] if self._swaying else np.zeros(3)

    def _step(self, x, look, weights, scale):
        """Return Gauss and Newton's step, and the information at its end."""
        slopes = look.slopes
        if self._swaying:
            slopes = np.concatenate([slopes, look.sway], axis=2)
        rows = (slopes * self._unit * (np.sqrt(weights) / scale)[:, None, None]).reshape(
            -1, x.size)
        right = (look.away * (np.sqrt(weights) / scale)[:, None]).ravel()
        information = self._information + rows.T @ rows
        down = rows.T @ right - self._information @ (x - self._before)
        return np.linalg.solve(information, down), information

    def _moved(self, x, step, shape, slopes):
        """Return the unknowns and the Shape after a step, and whether all of it could be made."""
        n = self._uncertain.size
        way = np.linalg.norm(slopes @ (step * self._unit)[:n], axis=1).max()
        part = min(1.0, _FARTHEST * shape.s[-1] / way) if way > 0 else 1.0
        for _ in range(_HALVINGS):
            z, _ = self._parts(x + part * step)
            gripper = self._seen.gripper.compose(self._uncertain.offset(z))
            trial = settled(self._varied, z, gripper, shape, followed=False)
            if trial.converged:
                break
            part *= 0.5
        return x + part * step, trial, part == 1.0

    def _result(self, x, shape, information, look, weights):
        n = self._uncertain.size
        covariance = np.linalg.inv(information)[:n, :n] * np.outer(self._unit[:n], self._unit[:n])
        own = max(float(weights.sum()), 1e-300)
        misfit = np.sqrt(weights @ np.sum(look.away**2, axis=1) / own)
        return replace(self._estimate, mean=self._parts(x)[0], covariance=_symmetric(covariance),
                       looks=self._estimate.looks + 1, converged=True, misfit=float(misfit),
                       outliers=float(1 - weights.mean()), _shape=shape)


def _symmetric(matrix):
    return 0.5 * (matrix + matrix.T)
