# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Small shifts of the gripper with which the moving DLO passes where the hanging one would.

Inertia moves a DLO aside by some millimeters, as the way of the hanging one is curved, and leaves a
vibration where a leg ends. The gripper is shifted by a spline in time, so that both are least: a
linear least-squares problem, as the DLO's answer is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline

from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.plan.motion.oscillators import vibrated
from dlo_planner.plan.motion.shift import DEGREE, Shift
from dlo_planner.plan.motion.time_law import TimeLaw

if TYPE_CHECKING:
    from dlo_planner.plan.motion.calm import LegTask
    from dlo_planner.plan.motion.cases import Case

_PER_PERIOD = 5   # pieces of the spline in the slowest period
_SMALL = 3e-2     # weight of the shift beside the deviation: none that hardly helps
_BEFORE = 0.05    # weight of the free end's deviation before something is passed
_NEAR = 0.01      # of the length: from so near on the free end counts as if it passed
_LONGEST = 50.0   # slowest periods: a longer leg is so slow that a shift is of no use
_PART = 50        # instants in which what is passed weighs as much as the end of the leg


def compensated(task: LegTask, law: TimeLaw,
                begins: Sequence[Floats] | None = None,
                check: Callable[[], None] = lambda: None) -> Shift | None:
    """Return the Shift that makes the deviations of a LegTask's DLOs least.

    None on a leg that is too short for one, or takes very many periods of the DLO.

    Parameters
    ----------
    law : TimeLaw
    begins : sequence of ndarray, optional
        (2, m) states of the cases at the beginning. If None, at rest.
    check : callable, optional
        Called before each of them; it may raise.
    """
    period = 2 * np.pi / task.response.rates.min()
    knots, inner = _knots(min(law.duration, _LONGEST * period), period)
    if not inner.size or law.duration > _LONGEST * period:
        return None
    basis = BSpline(knots, np.eye(knots.size - DEGREE - 1)[:, inner], DEGREE)
    normal, right = _SMALL**2 * np.eye(3 * inner.size), np.zeros(3 * inner.size)
    for case, begin in zip(task.cases, task.rest if begins is None else begins, strict=True):
        check()
        rows, own = _answers(case, law, begin, basis)
        normal += rows.T @ rows / case.allowed**2
        right -= rows.T @ own / case.allowed**2
    coefficients = np.zeros((knots.size - DEGREE - 1, 3))
    # the small weight of the shift itself keeps that well posed
    coefficients[inner] = np.linalg.solve(normal, right).reshape(3, -1).T
    return Shift(knots, coefficients)


def _answers(case: Case, law: TimeLaw, begin: Floats, basis: BSpline) -> tuple[Floats, Floats]:
    """Return what counts of the deviation of a Case, by the coefficients (r, 3 k) and before (r,).

    Parameters
    ----------
    begin : ndarray, shape (2, m)
        State at the beginning.
    basis : BSpline
        BSpline with k pieces; coefficients along x come first, then y, then z.
    """
    response = case.response
    times, u, rates, damping, turns = response.oscillators(law)
    middle = 0.5 * (times[1:] + times[:-1])
    pulled = response.between(response.pulls, law.at(middle)[0])
    force = -np.einsum('tmi,tk->iktm', pulled, basis(middle, 2)).reshape(-1, *pulled.shape[:2])
    places = np.einsum('tk,ij->iktj', basis(times), np.eye(3)).reshape(len(force), -1, 3)
    own = response.excited(law, begin)[2]
    rest = np.zeros((2, len(force), pulled.shape[1]))
    answers = vibrated(times[1], rates, damping, turns, force, rest)
    rows, before = [], []
    for passage in case.passed:
        moved = response.between(passage.across, u)
        near = response.between(passage.before, u) <= _NEAR * response.shapes[0].s[-1]
        weight = np.where(near, 1.0, _BEFORE)[:, None] / np.sqrt(len(times) / _PART)
        before.append((np.einsum('tmi,tm->ti', moved, own[0]) * weight).ravel())
        away = np.einsum('tmi,ctm->cti', moved, answers[0]) + places
        rows.append((away * weight).reshape(len(force), -1).T)
    sizes = response.sizes[-1]
    before.append((sizes * own[:, -1]).ravel())
    rows.append(np.moveaxis(sizes * answers[:, :, -1], 1, 2).reshape(-1, len(force)))
    return np.vstack(rows), np.concatenate(before)


def _knots(duration: float, period: float) -> tuple[Floats, Ints]:
    """Return knots of a spline over the duration, and which coefficients leave its ends at rest."""
    pieces = max(1, int(duration / period * _PER_PERIOD))
    knots = np.concatenate([[0.0] * DEGREE, np.linspace(0, duration, pieces + 1),
                            [duration] * DEGREE])
    return knots, np.arange(DEGREE, knots.size - 2 * DEGREE - 1)
