"""Small shifts of the gripper with which the moving DLO passes where the hanging one would.

Inertia moves a DLO aside by some millimeters, as the way of the hanging one is curved, and leaves a
vibration where a leg ends. The gripper is shifted by a spline in time, so that both are least: a
linear least-squares problem, as the DLO's answer is linear.
"""

import numpy as np
from scipy.interpolate import BSpline

from dlo_planner.inverse.oscillators import vibrated
from dlo_planner.inverse.shift import DEGREE, Shift

_PER_PERIOD = 5   # pieces of the spline in the slowest period
_SMALL = 3e-2     # weight of the shift beside the deviation: none that hardly helps
_BEFORE = 0.05    # weight of the free end's deviation before something is passed
_PART = 50        # instants in which what is passed weighs as much as the end of the leg


def compensated(task, law):
    """Return the Shift that makes the deviation of a LegTask's DLO least, None on a short leg.

    Args:
        law: TimeLaw
    """
    response = task.response
    times, u, rates, damping = response.oscillators(law)
    knots, inner = _knots(law.duration, 2 * np.pi / response.rates.min())
    if not inner.size:
        return None
    basis = BSpline(knots, np.eye(knots.size - DEGREE - 1)[:, inner], DEGREE)
    middle = 0.5 * (times[1:] + times[:-1])
    pulled = response.between(response.pulls, law.at(middle)[0])
    bends, places = basis(middle, 2), basis(times)
    own = response.excited(law)[2]
    answers = [[vibrated(times[1], rates, damping, -pulled[:, :, axis] * bends[:, k:k + 1])
                for k in range(inner.size)] for axis in range(3)]
    rows, wanted = [_SMALL * np.eye(3 * inner.size)], [np.zeros(3 * inner.size)]
    for begin, sideways in task.passed:
        moved = response.between(sideways, u)
        weight = np.where(u >= begin, 1.0, _BEFORE)[:, None] / np.sqrt(len(times) / _PART)
        wanted.append(-(np.einsum('tmi,tm->ti', moved, own[0]) * weight).ravel())
        rows.append(np.stack([((np.einsum('tmi,tm->ti', moved, answers[axis][k][0])
                                + places[:, k:k + 1] * np.eye(3)[axis]) * weight).ravel()
                              for axis in range(3) for k in range(inner.size)], axis=1))
    sizes = response.sizes[-1]
    wanted.append(-(sizes * own[:, -1]).ravel())
    rows.append(np.stack([(sizes * answer[:, -1]).ravel() for axis in answers for answer in axis],
                         axis=1))
    rows = np.vstack(rows)
    # well conditioned, as every coefficient has a row of its own; lstsq takes 20 times as long
    found = np.linalg.solve(rows.T @ rows, rows.T @ np.concatenate(wanted))
    coefficients = np.zeros((knots.size - DEGREE - 1, 3))
    coefficients[inner] = found.reshape(3, -1).T
    return Shift(knots, coefficients)


def _knots(duration, period):
    """Return knots of a spline over the duration, and which coefficients leave its ends at rest."""
    pieces = max(1, int(duration / period * _PER_PERIOD))
    knots = np.concatenate([[0.0] * DEGREE, np.linspace(0, duration, pieces + 1),
                            [duration] * DEGREE])
    return knots, np.arange(DEGREE, knots.size - 2 * DEGREE - 1)
