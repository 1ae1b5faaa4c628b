# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Observations as a function of what is unknown: properties of the rod, errors of the poses."""

from functools import cached_property, partial

import numpy as np

from dlo_planner.direct.guide import Guide
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.identify.misfit import (
    MOVED,
    STEP,
    PoseErrors,
    at_rest,
    in_motion,
    nowhere,
    seen_in,
)
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose

_AT_REST, _IN_MOTION = 1e-6, 1e-4  # relative errors of the derivatives
_STEPPED, _MOST_PARTS = 1e-4, 16  # of the length; of a motion's dt
_KEPT = 4  # values of x whose misfits are remembered


class Misfits:
    """The Misfits of all observations, as one.

    Attributes:
        away: (m, 3) m; counts: (m, 3), as of a Misfit
        shapes: of the observations; converged: whether all are solved, and any: whether one is
    """

    def __init__(self, parts):
        self._parts = parts
        self.away, self.counts = (np.concatenate([getattr(part, name) for part in parts])
                                  for name in ('away', 'counts'))
        self.shapes = tuple(part.shape for part in parts)
        self.converged = all(part.converged for part in parts)
        self.any = any(part.converged for part in parts)

    @cached_property
    def slopes(self) -> np.ndarray:
        """(m, 3, n) derivatives of `away` by the unknowns; computed when first read."""
        return np.concatenate([part.slopes() for part in self._parts])


class Observed:
    """Observations as a function of unknowns x (n,): parameters first, then errors of the poses.

    Errors of each pose are in standard deviations; that of a motion is the same all along.

    Args:
        unknowns: Unknowns
        observations: Observations; motions: ObservedMotions
        pose: (k, 6) unit vectors times standard deviations, rad before m, of the errors to be found
        options: of the `DirectSimulator`
        progress: Progress
    """

    def __init__(self, unknowns, observations, motions, pose, options, progress):
        self.unknowns, self.rod = unknowns, unknowns.rod
        self.observations, self.motions = observations, motions
        self._pose, self._options, self._progress = pose, options, progress
        self.n_parameters = unknowns.size
        self.size = unknowns.size + len(pose) * (len(observations) + len(motions))
        free = np.full(self.size - unknowns.size, np.inf)
        self.bounds = np.append(unknowns.lower, -free), np.append(unknowns.upper, free)
        self.precision = _IN_MOTION if motions else _AT_REST
        self._parts = [1] * len(motions)  # steps in each dt
        self.begin()

    def choose_steps(self, x: np.ndarray) -> None:
        """Halve the steps of the motions until that changed little at x (n,).

        They then stay the same: steps that follow an error would make derivatives noisy.
        """
        for index, one in enumerate(self.motions):
            coarse, _ = self._seen(index, one, x)
            while self._parts[index] < _MOST_PARTS:
                self._parts[index] *= 2
                fine, _ = self._seen(index, one, x)
                if coarse is not None and fine is not None and (
                        np.abs(fine - coarse).max() <= _STEPPED * self.rod.length):
                    break
                coarse = fine
        self.begin()

    def begin(self) -> None:
        """Forget the shapes from which the search for the next ones begins."""
        self._known, self._held, self._begins = {}, {}, {}

    def at(self, x: np.ndarray) -> Misfits:
        """Return the Misfits at unknowns x (n,)."""
        key = x.tobytes()
        if key not in self._known:
            self._known = {**dict(list(self._known.items())[1 - _KEPT:]), key: self._at(x)}
        return self._known[key]

    def errors(self, index: int, x: np.ndarray) -> PoseErrors:
        """Return the PoseErrors of an observation (motions come after what is at rest)."""
        begin = self.n_parameters + len(self._pose) * index
        return PoseErrors(self._pose, slice(begin, begin + len(self._pose)), x)

    def grippers(self, x: np.ndarray) -> tuple[Pose, ...]:
        """Return the Poses of the observations at rest, corrected."""
        return tuple(self.errors(k, x).applied(one.gripper)
                     for k, one in enumerate(self.observations))

    def _at(self, x):
        direct = self._simulator(x)
        nearby = _Nearby(self.unknowns, x)
        parts = []
        for index, one in enumerate(self.observations):
            errors = self.errors(index, x)
            shape = self._shape(direct, index, one, errors)
            self._progress.check()
            parts.append(at_rest(one, shape, nearby.on, errors) if shape.converged
                         else nowhere(one.points, self.rod.length, x.size, shape))
        parts += [self._motion(index, one, x) for index, one in enumerate(self.motions)]
        return Misfits(parts)

    def _simulator(self, x):
        return DirectSimulator(self.unknowns.of(x[:self.n_parameters]), **self._options)

    def _shape(self, direct, index, one, errors):
        """Return the Shape of an observation.

        It is set down in its natural shape each time: from another shape it may come to a third.
        A DLO held at both ends, which takes long to get there, stays where it was led once.
        """
        gripper = errors.applied(one.gripper)
        before = self._held.get(index)
        shape = direct.solve(gripper, before, far_end=one.far_end)
        if before is not None and not shape.converged:
            shape = direct.solve(gripper, far_end=one.far_end)
        if one.far_end is not None and shape.converged:
            self._held[index] = shape
        return shape

    def _motion(self, index, one, x):
        where = self.errors(len(self.observations) + index, x).where
        lower = self.bounds[0]
        columns = [(k, x[k] - MOVED >= lower[k]) for k in range(x.size)
                   if k < self.n_parameters or where.start <= k < where.stop]
        return in_motion(one, x, partial(self._seen, index, one), columns, x.size,
                         self.rod.length)

    def _seen(self, index, one, x):
        """Return where the points of a motion are at x, (k, m, 3) or None; and its last Shape."""
        parts, errors = self._parts[index], self.errors(len(self.observations) + index, x)
        grippers = _refined([errors.applied(pose) for pose in one.grippers], one.dt, parts)
        ends = one.far_ends
        if ends is not None:
            grip = ends[0].grip
            ends = [FarEnd(pose, grip)
                    for pose in _refined([end.pose for end in ends], one.dt, parts)]
        direct = self._simulator(x)
        initial = self._begun(direct, index, grippers[0], ends) if one.initial is None else (
            one.initial)
        motion = direct.simulate(grippers, one.dt / parts, initial, far_ends=ends,
                                 tolerance=np.inf)
        self._progress.check()
        solved = motion.converged and len(motion) == len(grippers)
        return (seen_in(motion, one.times, one.s) if solved else None), motion.shapes[-1]


    def _begun(self, direct, index, gripper, ends):
        """Return the static Shape in which a DLO held at both ends begins; None: it is free."""
        if ends is None:
            return None
        shape = direct.solve(gripper, self._begins.get(index), far_end=ends[0])
        if not shape.converged:
            return None
        self._begins.setdefault(index, shape)
        return shape


def _refined(given, dt, parts):
    """Return Poses at `parts` times as many instants, on the smooth way through those given."""
    if parts == 1:
        return given
    guide = Guide(given, dt)
    return [guide.at(k / parts) for k in range((len(given) - 1) * parts + 1)]


class _Nearby:
    """Rods that differ a little, each on a mesh once for all shapes on that mesh."""

    def __init__(self, unknowns, x):
        self._unknowns, self._x = unknowns, x[:unknowns.size]
        self._base, self._on_base = None, ()

    @cached_property
    def _rods(self):
        columns = np.flatnonzero(self._unknowns.at_rest)
        steps = STEP * np.eye(self._x.size)[columns]
        return [(k, self._unknowns.of(self._x + step), self._unknowns.of(self._x - step))
                for k, step in zip(columns, steps, strict=True)]

    def on(self, shape):
        """Return (column, Discretization ahead, back) with the elements of a Shape."""
        if shape._discretization is not self._base:
            self._base = shape._discretization
            self._on_base = tuple((k, self._base.of(ahead), self._base.of(back))
                                  for k, ahead, back in self._rods)
        return self._on_base
