# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Time integration: every scheme says where inertia draws a coordinate, and how strongly.

All are members of one family (generalized alpha: Chung and Hulbert 1993, for constrained bodies
Arnold and Bruels 2007). The acceleration at the end of a step is a linear function of the position
there, y'' = stiffness (y - anchor), so a step is a minimization (Eq. 9 to 11 of the paper), and
that acceleration is in balance with the forces at the same instant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from dlo_planner.direct.swinging import third_difference
from dlo_planner.model.arrays import Floats

INTEGRATORS = ('generalized_alpha', 'paper')


@dataclass(frozen=True)
class Scheme:
    """Coefficients of the family, for one step length dt in s."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    dt: float

    @classmethod
    def named(cls, name: str, dt: float, high_frequency: float = 0.85) -> Self:
        """Return the scheme `name` of INTEGRATORS.

        'generalized_alpha' is of second order; `high_frequency` is what one step leaves of the
        fastest vibrations (1: all of them), and slow ones are hardly damped. 'paper' is Eq. 8 to
        10: constant acceleration over a step, taken at its end; as a Newmark method beta = 1/2,
        gamma = 1, of first order, and it damps: a vibration of angular frequency w loses the part
        w dt / 4 of its amplitude per radian. 'euler' (for a `uniform` course) is the implicit one.
        """
        if name == 'euler':
            return cls(0.0, 0.0, 1.0, 1.0, dt)
        if name == 'paper':
            return cls(0.0, 0.0, 0.5, 1.0, dt)
        alpha_m = (2 * high_frequency - 1) / (high_frequency + 1)
        alpha_f = high_frequency / (high_frequency + 1)
        return cls(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2,
                   0.5 - alpha_m + alpha_f, dt)

    @property
    def first_order(self) -> bool:
        """Whether it is of first order only."""
        return self.gamma == 1.0

    @property
    def stiffness(self) -> float:
        """Acceleration at the end per distance from the anchor, 1/s^2: 2 / dt^2 in Eq. 9."""
        return (1 - self.alpha_m) / ((1 - self.alpha_f) * self.beta * self.dt**2)

    @property
    def velocity_gain(self) -> float:
        """Velocity at the end per distance from the anchor, 1/s."""
        return self.gamma / (self.beta * self.dt)

    def anchor(self, before: 'KinematicState') -> tuple[Floats, Floats]:
        """Return position and velocity (arrays) at the end of a step that feels no force."""
        dt = self.dt
        free = self._mean_acceleration(before, 0.0)
        position = (before.position + dt * before.velocity
                    + dt**2 * ((0.5 - self.beta) * before.mean + self.beta * free))
        velocity = before.velocity + dt * ((1 - self.gamma) * before.mean + self.gamma * free)
        return position, velocity

    def after(self, before: 'KinematicState', position: Floats) -> 'KinematicState':
        """Return the KinematicState at the end of a step that ends at `position`."""
        anchor, velocity = self.anchor(before)
        away = position - anchor
        acceleration = self.stiffness * away
        return KinematicState(position, velocity + self.velocity_gain * away, acceleration,
                              self._mean_acceleration(before, acceleration))

    def error(self, times: Sequence[float], positions: Sequence[Floats]) -> float:
        """Return the local error (m) of a step, to leading order: the largest of a node.

        What the scheme's position differs by from Taylor's series of the true one:
        (1/6 - beta - (alpha_f - alpha_m) / 2) dt^3 x'''. Accelerations are no measure of it: they
        are those that keep the DLO's length, and tell of changes of the step as well.

        Parameters
        ----------
        times : sequence
            Four times, s, the last one at the end of the step.
        positions : sequence
            4 arrays (N + 1, 3) at these times, m.
        """
        return self.third * float(third_difference(np.array(times), np.array(positions), 3))

    @property
    def third(self) -> float:
        """Local error per divided difference of four places, s^3, see `error`."""
        return 6 * abs(1 / 6 - self.beta - 0.5 * (self.alpha_f - self.alpha_m)) * self.dt**3

    def _mean_acceleration(self, before: 'KinematicState', acceleration: Floats | float) -> Floats:
        return ((1 - self.alpha_f) * acceleration + self.alpha_f * before.acceleration
                - self.alpha_m * before.mean) / (1 - self.alpha_m)


@dataclass(frozen=True)
class KinematicState:
    """A coordinate in motion: arrays of one shape.

    Attributes
    ----------
    position : ndarray
        At one instant.
    velocity : ndarray
        At one instant.
    acceleration : ndarray
        At one instant.
    mean : ndarray
        The acceleration averaged over the last step, as the scheme carries it along.
    """

    position: Floats
    velocity: Floats
    acceleration: Floats
    mean: Floats

    def __post_init__(self) -> None:
        for one in self.arrays:  # not `freeze`: there are thousands
            one.flags.writeable = False

    @property
    def arrays(self) -> tuple[Floats, ...]:
        """The four arrays."""
        return tuple(self.__dict__.values())

    @classmethod
    def of(cls, arrays: Floats) -> Self:
        """Return the course with the four parts of a read-only array (4, ...): quicker."""
        course = object.__new__(cls)
        course.__dict__.update(zip(_PARTS, arrays, strict=True))
        return course

    @classmethod
    def begun(cls, position: Floats, velocity: Floats, acceleration: Floats) -> Self:
        """Return the course of something that begins to move freely."""
        return cls(position, velocity, acceleration, acceleration)

    def uniform(self) -> Self:
        """Return the same course as if nothing accelerated it."""
        none = np.zeros_like(self.position)
        return replace(self, acceleration=none, mean=none)


_PARTS = tuple(item.name for item in fields(KinematicState))
