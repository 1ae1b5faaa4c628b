# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A small motion of a standing gripper that takes the vibration of its DLO away.

The gripper is displaced in smooth steps, and comes back to where it stood. What they do to each
mode is linear, so those are wanted that leave least of the vibration: linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_planner.execute.limiter import used
from dlo_planner.identify.blending import Change, step_response
from dlo_planner.identify.steering import Steered
from dlo_planner.identify.vibration import FreeVibration
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.modal_response import vibrated
from dlo_planner.trajectory.timed_path import TimedPath

_WIDTH = 0.1       # of the slowest period, of each of three windows that smooth a step
_PULSES = 10       # steps aside and back again, one after the other
_APART = 0.15      # of the slowest period, from one to the next
_LASTS = 2         # of them, until it goes back
_SMALL = 1e-3      # weight of a displacement beside that of the free end: no more than is needed
_STEP = 1 / 200    # of the slowest period
FARTHEST = 0.01   # m, that the gripper may be displaced
_LIMITS = 0.95     # of the limits
_DELAYS = np.linspace(-0.1, 0.4, 101)  # s


@dataclass(frozen=True, eq=False)
class Calming:
    """A motion that takes most of a vibration away.

    Attributes
    ----------
    before : FreeVibration
    way : Steered
        From where the gripper stands, and back.
    stamp : float
        When it ends, s.
    answer : ndarray, shape (2, m)
        State of the DLO then if it had been at rest before.
    """

    before: FreeVibration
    way: Steered
    stamp: float
    answer: Floats

    @classmethod
    def of(cls, vibration: FreeVibration, stamp: float, delay: float, here: Pose, limits: Limits,
           period: float, farthest: float = FARTHEST) -> Calming:
        """Return that from a stamp (s) on: as much as is possible within the limits."""
        slowest = float(2 * np.pi / vibration.rates.min())
        windows: Floats = np.full(3, float(np.clip(_WIDTH * slowest, 0.02, 5.0)))
        begins: Floats = _APART * slowest * np.arange(float(_PULSES))
        lasts = _LASTS * _APART * slowest
        duration = float(begins[-1] + lasts + windows.sum())
        answers = _answers(vibration, begins, lasts, windows, duration)
        sizes = np.linalg.norm(vibration.modes.displacements[:, -1], axis=1)
        left = (sizes * vibration.after(stamp + delay - vibration.stamp + duration)).ravel()
        rows = (answers * sizes).reshape(len(answers), -1).T
        pulses = -np.linalg.solve(rows.T @ rows + _SMALL**2 * np.eye(len(answers)),
                                  rows.T @ left)
        path = GripperPath.through([here, here], [0.0, duration], 1.0)

        def way(pulses: Floats) -> Steered:
            changes = [Change(begin + later, np.zeros(1), np.append(np.zeros(3), sign * pulse)[
                None]) for begin, pulse in zip(begins, pulses.reshape(-1, 3), strict=True)
                for later, sign in ((0.0, 1.0), (lasts, -1.0))]
            return Steered(TimedPath(path, (None,), limits), windows, tuple(changes))

        frames = way(pulses).frames(np.arange(0.0, duration + 4 * period, period))
        away = np.linalg.norm(frames[0] - here.position, axis=1).max()
        most = max(used(frames, limits, period) / _LIMITS, float(away) / farthest)
        pulses /= max(most, 1.0)
        return cls(vibration, way(pulses), stamp + duration, np.tensordot(pulses, answers, 1))

    def delay(self, after: FreeVibration) -> float:
        """Return by how much later than commanded the DLO answered, as it was seen, s."""
        before, size = self.before, []
        for delay in _DELAYS:
            answer = before.decayed(self.answer, after.stamp - self.stamp - delay)
            state = before.after(after.stamp - before.stamp) + answer
            size.append(np.linalg.norm(before.end(state) - after.end(after.state)))
        return float(_DELAYS[int(np.argmin(size))])


def _answers(vibration: FreeVibration, begins: Floats, lasts: float, windows: Floats,
             duration: float) -> Floats:
    """Return (3 k, 2, m) what each of k pulses along each axis leaves of the modes at the end."""
    count = int(np.ceil(duration * vibration.rates.min() / (2 * np.pi * _STEP)))
    step = duration / count
    middle = step * (np.arange(count) + 0.5)
    pulls = vibration.modes.participation[:, :3]
    modes = vibration.rates.size
    force = np.array([-np.outer(step_response(middle - begin, windows, 2)
                                - step_response(middle - begin - lasts, windows, 2), pull)
                      for begin in begins for pull in pulls.T])
    damping = np.tile(vibration.modes.damping_ratios, (count, 1))
    turns = np.tile(np.eye(modes), (count, 1, 1))
    out = vibrated(step, np.tile(vibration.rates, (count, 1)), damping, turns, force,
                   np.zeros((2, len(force), modes)))
    return np.moveaxis(out[:, :, -1], 0, 1)
