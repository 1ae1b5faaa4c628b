# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The DLOs with which a time law is judged, and how each passes the centers of cut-outs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.plan.motion.leg_response import Response
from dlo_planner.plan.motion.time_law import TimeLaw

_ARRIVING = 0.5  # part of the tolerance that may be left of a vibration where a leg ends


@dataclass(frozen=True)
class Passage:
    """How a DLO passes a center; n parameters and m modes as of its Response.

    Attributes
    ----------
    before : ndarray, shape (n,)
        Distance in m of the free end from the center before it is passed; 0 from then on.
    across : ndarray, shape (n, m, 3)
        Displacements in m by the modes of what passes; before that, of the free end.
    tangents : ndarray, shape (n, 3)
        Tangents there.
    ahead : ndarray, shape (n, m)
        Displacements in m along the tangents.
    """

    before: Floats
    across: Floats
    tangents: Floats
    ahead: Floats

    @classmethod
    def of(cls, response: Response, s: Floats) -> Passage:
        """Return the Passage at arc lengths s (n,), nan where the center is not passed."""
        first = np.argmax(np.isfinite(s))
        end = response.shapes[0].s[-1]
        across, tangents, ahead = response.sideways(np.where(np.isnan(s), end, s))
        ends = np.array([shape.positions_at([end])[0] for shape in response.shapes])
        before = np.einsum('ni,ni->n', tangents, ends[first] - ends)
        before[first:] = 0.0
        return cls(before, across, tangents, ahead)

    def deviation(self, response: Response, u: Floats, place: Floats, shift: Floats) -> Floats:
        """Return (k, 3) m: where the moving DLO passes, at those instants at which it does.

        Shapes: u (t,), place (t, m), shift (t, 3).
        """
        ahead = (np.einsum('tm,tm->t', response.between(self.ahead, u), place)
                 + np.einsum('ti,ti->t', response.between(self.tangents, u), shift))
        # a DLO that swings ahead comes to the center earlier than one that hangs
        passes = response.between(self.before, u) <= np.maximum(ahead, 0.0)
        across = response.between(self.across, u[passes])
        result: Floats = shift[passes] + np.einsum('tmi,tm->ti', across, place[passes])
        return result


@dataclass(frozen=True)
class Case:
    """One of the DLOs with which a law is judged.

    Attributes
    ----------
    response : Response
    holes : ndarray
        As of its LegTask.
    last : bool
        Whether the plan ends with its leg.
    allowed : float
        Allowed deviation, as a multiple of the tolerance.
    """

    response: Response
    holes: Floats
    last: bool
    allowed: float

    @cached_property
    def passed(self) -> list[Passage]:
        """The Passage through each center that is passed."""
        return [Passage.of(self.response, s) for s in self.holes if np.isfinite(s).any()]

    def deviation(self, law: TimeLaw, begin: Floats) -> tuple[float, Floats]:
        """Return the largest deviation that counts, in m, and the state at the end of a TimeLaw.

        As long as a center is passed: that of what passes it, across the DLO. At the end of a leg:
        what is left of the vibration; of a leg that others follow only a part, _ARRIVING, is
        allowed. States are y and y'/w (2, m) of the modes; `begin` is that at the beginning.
        """
        response = self.response
        times, u, (place, speed) = response.excited(law, begin)
        left = float((response.sizes[-1] * np.hypot(place[-1], speed[-1])).sum())
        worst = left if self.last else left / _ARRIVING
        shift = np.zeros((len(times), 3)) if law.shift is None else law.shift.at(times)
        for passage in self.passed:
            away = passage.deviation(response, u, place, shift)
            worst = max(worst, float(np.linalg.norm(away, axis=1).max(initial=0.0)))
        return worst, np.stack([place[-1], speed[-1]])
