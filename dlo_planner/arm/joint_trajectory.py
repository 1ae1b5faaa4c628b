# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion of an arm's joints as a controller interpolates it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly, PPoly

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, figure, items, number, row, shown
from dlo_planner.model.value import Value, brief, put


@dataclass(frozen=True, eq=False, repr=False)
class JointTrajectory(Value):
    """Positions, velocities and accelerations of m joints at n times.

    Between two points it is the polynomial of degree 5 that has all of them at both: that is what
    joint_trajectory_controller interpolates.

    Attributes
    ----------
    joint_names : tuple of str
        Joint names in m.
    times : ndarray, shape (n,)
        s from the start, increasing, the first 0.
    positions : ndarray, shape (n, m)
        rad or m.
    velocities : ndarray, shape (n, m)
        rad/s or m/s.
    accelerations : ndarray, shape (n, m)
        rad/s^2 or m/s^2.
    position_error : float
        Position error in m, by which the tool is off the gripper's trajectory at most, at the
        points and between; nan: not known.
    angle_error : float
        Angle error in rad, the same of its orientation.
    self_clearance : float
        Self clearance in m, smallest distance between links; infinite where no two can come
        together, nan where it was not looked at.
    roll : float
        Roll in rad, by which the gripper is rolled about the DLO, against its trajectory.
    not_looked_at : tuple of str
        Links without a shape to be looked at for self-collision.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    joint_names: tuple[str, ...]
    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats
    position_error: float = np.nan
    angle_error: float = np.nan
    self_clearance: float = np.nan
    roll: float = 0.0
    not_looked_at: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = items('joint_names', self.joint_names, str, least=1)
        if len(set(names)) < len(names):
            raise InvalidTask(f'joint_names = {shown(names)}: expected each joint once')
        times = row('times', self.times, least=2, minimum=0)
        if times[0] != 0 or not (np.diff(times) > 0).all():
            raise InvalidTask(f'times = {times.tolist()[:4]} ...: expected 0, and then increasing '
                              'ones')
        states = {name: array(name, getattr(self, name), (None, None))
                  for name in ('positions', 'velocities', 'accelerations')}
        for name, state in states.items():
            if state.shape != (times.size, len(names)):
                raise InvalidTask(f'{name} has shape {state.shape}: expected ({times.size}, '
                                  f'{len(names)}), as many as times and joint_names')
        put(self, joint_names=names, times=times, roll=number('roll', self.roll),
            not_looked_at=items('not_looked_at', self.not_looked_at, str), **states,
            **{name: figure(name, getattr(self, name))
               for name in ('position_error', 'angle_error', 'self_clearance')})
        super().__post_init__()

    def __len__(self) -> int:
        return self.times.size

    def __repr__(self) -> str:
        return brief(self, f'{len(self.joint_names)} joints', f'{len(self)} points',
                     f'{self.duration:.4g} s', f'off {self.position_error:.1g} m')

    @property
    def duration(self) -> float:
        """S, of the whole."""
        return float(self.times[-1])

    def at(self, times: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return positions, velocities and accelerations (k, m) at `times` (k,) s.

        At rest outside [0, duration].

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        times = np.clip(row('times', times), 0, self.duration)
        curve = quintic(self.times, self.positions, self.velocities, self.accelerations)
        return curve(times), curve(times, 1), curve(times, 2)


def quintic(times: Floats, positions: Floats, velocities: Floats, accelerations: Floats) -> PPoly:
    """Return the curve of degree 5 between the points; (n, m) each."""
    states = np.stack([positions, velocities, accelerations], axis=1)
    return PPoly.from_bernstein_basis(BPoly.from_derivatives(times, states))


def turning_points(curve: PPoly) -> list[Floats]:
    """Return for each of the m curves the times of its knots and of its extremes between."""
    found = curve.derivative().roots(discontinuity=False, extrapolate=False)
    return [np.union1d(curve.x, times[np.isfinite(times)]) for times in found]
