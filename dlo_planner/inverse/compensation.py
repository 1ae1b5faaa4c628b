"""Small shifts of the gripper that make the moving DLO pass where the DLO at rest would pass.

Inertia moves a DLO aside by some millimeters, because the path of its shapes at rest is curved, and
leaves a vibration at the end of a leg. A shift of the gripper, a spline in time, makes both least.
The DLO's response is linear in the shift, so this is a linear least-squares problem.
"""

import numpy as np
from scipy.interpolate import BSpline

from dlo_planner.inverse.leg_response import Response
from dlo_planner.inverse.oscillators import vibrated
from dlo_planner.inverse.shift import DEGREE, Shift
from dlo_planner.inverse.time_law import TimeLaw

_PER_PERIOD = 5   # pieces of the spline in the slowest period
_SMALL = 3e-2     # weight of the shift itself beside the deviation: no large shift for little gain
_BEFORE = 0.05    # weight of the free end's deviation before something is passed
_PART = 50        # all instants of a passage together weigh as much as this many ends of the leg


def compensated(response: Response, passed: list[tuple[float, np.ndarray]],
                law: TimeLaw) -> Shift | None:
    """Return the Shift that makes the predicted deviation on a leg least.

    None where the leg is shorter in time than such a spline needs.

    Args:
        response: Response on the leg
        passed: as `LegTask.passed`: from which parameter on a centre is passed, and by how much the
            modes displace the passing point
        law: TimeLaw without a shift
    """
    times, u, *oscillators = response.oscillators(law)
    knots, inner = _knots(law.duration, 2 * np.pi / response.rates.min())
    if not inner.size:
        return None
    basis = BSpline(knots, np.eye(knots.size - DEGREE - 1)[:, inner], DEGREE)
    middle = 0.5 * (times[1:] + times[:-1])
    pulled = response.between(response.pulls, law.at(middle)[0])
    # (3 k, t, m): the k splines of the basis along x, then y, then z
    force = -np.einsum('tmi,tk->iktm', pulled, basis(middle, 2)).reshape(-1, *pulled.shape[:2])
    places = np.einsum('tk,ij->iktj', basis(times), np.eye(3)).reshape(len(force), -1, 3)
    own = response.excited(law)[2]
    answers = vibrated(times[1], *oscillators, force)
    rows, wanted = [_SMALL * np.eye(3 * inner.size)], [np.zeros(3 * inner.size)]
    for begin, sideways in passed:
        moved = response.between(sideways, u)
        weight = np.where(u >= begin, 1.0, _BEFORE)[:, None] / np.sqrt(len(times) / _PART)
        wanted.append(-(np.einsum('tmi,tm->ti', moved, own[0]) * weight).ravel())
        away = np.einsum('tmi,ctm->cti', moved, answers[0]) + places
        rows.append((away * weight).reshape(len(force), -1).T)
    sizes = response.sizes[-1]
    wanted.append(-(sizes * own[:, -1]).ravel())
    rows.append(np.moveaxis(sizes * answers[:, :, -1], 1, 2).reshape(-1, len(force)))
    rows, wanted = np.vstack(rows), np.concatenate(wanted)
    found = np.linalg.solve(rows.T @ rows, rows.T @ wanted)  # regular because of the first rows
    coefficients = np.zeros((knots.size - DEGREE - 1, 3))
    coefficients[inner] = found.reshape(3, -1).T
    return Shift(knots, coefficients)


def _knots(duration, period):
    """Return knots of a spline over the duration, and which coefficients leave its ends at rest."""
    pieces = max(1, int(duration / period * _PER_PERIOD))
    knots = np.concatenate([[0.0] * DEGREE, np.linspace(0, duration, pieces + 1),
                            [duration] * DEGREE])
    return knots, np.arange(DEGREE, knots.size - 2 * DEGREE - 1)
