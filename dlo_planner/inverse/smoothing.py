"""The most likely state after the looks so far, and how far off it may be.

An iterated extended Kalman filter (Bell and Cathey 1993: each update is a Gauss-Newton search) in
information form. A filter that keeps each look linearised where it was taken in becomes too sure
of itself: what no look can tell, such as stiffness against weight, seems to be told by the
difference of two linearisations. So the last looks are remembered, and linearised anew at the
present state once it has moved (a smoother with a fixed lag); older ones stay as they are.
"""

from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.indicator import surely_within
from dlo_planner.direct.shape import Shape
from dlo_planner.inverse.looking import Told, from_either_end, looked_at
from dlo_planner.inverse.observation import Observation
from dlo_planner.inverse.response import node_slopes
from dlo_planner.inverse.settling import settled

_ITERATIONS = 30
_HALVINGS = 6
_SETTLED = 1e-3   # mean square of a step in standard deviations of what is known: the last one
_STEADY = 1.05    # ratio of two scales of what is left that are the same
_FARTHEST = 0.15  # of the length: by which one step may move a node
_MOVED = 0.1      # of the prior's standard deviations: a look is linearised anew
_REMEMBERED = 64  # looks


@dataclass(frozen=True, eq=False)
class Taken:
    """A look as it was taken in.

    Attributes:
        observation: Observation; s: (m,) its arc lengths from the gripper, or None
        x: (n,) state, in standard deviations of the prior, at which it was linearised
        shape: Shape there; told: Told
    """

    observation: Observation
    s: np.ndarray | None
    x: np.ndarray
    shape: Shape
    told: Told


@dataclass(frozen=True, eq=False)
class Memory:
    """What the estimate is made of; all in standard deviations of the prior.

    Attributes:
        x: (n,), matrix: (n, n): mean and information of all that is not remembered look by look
        taken: tuple of Taken
    """

    x: np.ndarray
    matrix: np.ndarray
    taken: tuple

    def total(self, more=()):
        """Return the information (n, n) and its product with the mean (n,), `more` Taken added."""
        matrix, vector = self.matrix.copy(), self.matrix @ self.x
        for one in (*self.taken, *more):
            matrix += one.told.matrix
            vector += one.told.matrix @ one.x + one.told.vector
        return matrix, vector

    def with_look(self, one):
        """Return the Memory with one more Taken; the oldest is no longer remembered by itself."""
        taken = (*self.taken, one)
        if len(taken) <= _REMEMBERED:
            return replace(self, taken=taken)
        matrix, vector = replace(self, taken=taken[:1]).total()
        return Memory(np.linalg.solve(matrix, vector), matrix, taken[1:])


class Search:
    """One more look at the DLO.

    Args:
        observer: Observer; estimate: Estimate before; observation: Observation
        wandered: mean square by which the state has wandered since, in that of the prior
    """

    def __init__(self, observer, estimate, observation, wandered):
        self._observer, self._estimate, self._seen = observer, estimate, observation
        self._unit = observer.uncertain.deviations
        memory = estimate._memory
        if memory is None or wandered:
            covariance = estimate.covariance / np.outer(self._unit, self._unit)
            memory = Memory(estimate.mean / self._unit,
                            np.linalg.inv(covariance + wandered * np.eye(self._unit.size)), ())
        self._memory, self._s = memory, observation.s

    def found(self):
        """Return the Estimate, or None if no equilibrium explains the look."""
        x = self._estimate.mean / self._unit
        shape, last = self._first(), np.inf
        if shape.converged and self._s is not None:
            self._s = from_either_end(shape, self._seen.points, self._s)
        for _ in range(_ITERATIONS):
            if not shape.converged:
                return None
            slopes = node_slopes(self._varied, x * self._unit, shape)
            new = self._taken(self._seen, self._s, x, shape, slopes)
            matrix, vector = self._memory.total((new,))
            step = np.linalg.solve(matrix, vector) - x
            still = float(step @ matrix @ step) < _SETTLED * step.size
            stale = still and self._refreshed(x, shape, slopes)
            if not stale:
                before = x
                x, shape = self._moved(x, step, shape, slopes)
                if still and last <= _STEADY * new.told.scale and shape.converged:
                    return self._result(before, step, shape, matrix, new)
            last = new.told.scale
        return None

    def _first(self):
        """Return the Shape in the gripper of this look, at the state before it."""
        estimate = self._estimate
        simulator, known = estimate.uncertain.simulator, estimate._shape
        gripper = estimate.actual(self._seen.gripper)
        good = known is not None and (simulator.accuracy is None
                                      or surely_within(known, simulator.accuracy))
        mesh = known._discretisation if good else simulator.discretisation(gripper, None)
        self._varied = estimate.uncertain.varied(mesh)
        return settled(self._varied, estimate.mean, gripper, known)

    def _taken(self, observation, s, x, shape, slopes):
        """Return the Taken of a look at x; its slopes by standard deviations of the prior."""
        observer = self._observer
        look = looked_at(self._varied, shape, slopes, observation.points, s,
                         observer.uncertain.camera(x * self._unit))
        look = replace(look, slopes=look.slopes * self._unit)
        return Taken(observation, s, x, shape, look.information(
            observer.noise, observer.outliers, observer.sway, shape.s[-1]))

    def _refreshed(self, x, shape, slopes):
        """Linearise remembered looks anew where the state has moved; return whether it had."""
        old = [one for one in self._memory.taken if np.abs(x - one.x).max() > _MOVED]
        if not old:
            return False
        known = {self._seen.gripper: (shape, slopes)}
        taken = []
        for one in self._memory.taken:
            gripper = one.observation.gripper
            if gripper not in known:
                known[gripper] = self._shape_and_slopes(x, gripper, one.shape)
            here, by_state = known[gripper]
            taken.append(one if by_state is None else self._taken(
                one.observation, one.s, x, here, by_state))
        self._memory = replace(self._memory, taken=tuple(taken))
        return True

    def _shape_and_slopes(self, x, gripper, before):
        """Return the Shape in another gripper and its slopes; None where there is none."""
        z = x * self._unit
        offset = self._estimate.uncertain.offset(z)
        shape = settled(self._varied, z, gripper.compose(offset), before, followed=False)
        return shape, node_slopes(self._varied, z, shape) if shape.converged else None

    def _moved(self, x, step, shape, slopes):
        """Return state and Shape after a step, or after as much of it as can be made."""
        way = np.linalg.norm(slopes @ (step * self._unit), axis=1).max()
        part = min(1.0, _FARTHEST * shape.s[-1] / way) if way > 0 else 1.0
        for _ in range(_HALVINGS):
            z = (x + part * step) * self._unit
            gripper = self._seen.gripper.compose(self._estimate.uncertain.offset(z))
            trial = settled(self._varied, z, gripper, shape, followed=False)
            if trial.converged:
                break
            part *= 0.5
        return x + part * step, trial

    def _result(self, x, step, shape, matrix, new):
        covariance = np.linalg.inv(matrix) * np.outer(self._unit, self._unit)
        return replace(self._estimate, mean=(x + step) * self._unit,
                       covariance=symmetric(covariance), looks=self._estimate.looks + 1,
                       converged=True, misfit=new.told.misfit, outliers=new.told.outliers,
                       _shape=shape, _memory=self._memory.with_look(new))


def symmetric(matrix):
    """Return the symmetric part of a matrix (n, n)."""
    return 0.5 * (matrix + matrix.T)
