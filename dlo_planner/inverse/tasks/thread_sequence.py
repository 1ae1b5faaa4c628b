# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Thread the free end through any number of cut-outs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.threading.sequence import thread_sequence
from dlo_planner.inverse.task import Task, depths_on, depths_or_none
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.inverse.tasks.thread_two import ThreadTwo
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, row
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan


@dataclass(frozen=True, eq=False, repr=False)
class ThreadSequence(Task):
    """Thread near the centers of cut-outs; see `InverseSimulator.thread_sequence`.

    Attributes
    ----------
    cutouts : tuple of CutOut
        The cut-outs, in the order in which they are passed.
    weights : ndarray, shape (k,) or None
        Weights of their distances. If None, all alike.
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through the first one, m, or None.
    """

    cutouts: tuple[CutOut, ...]
    weights: Floats | None = None
    depths: Floats | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, cutouts: Iterable[CutOut], weights: ArrayLike | None = None,
                     depths: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        cutouts = items('cutouts', self.cutouts, CutOut, least=1)
        weights = None if self.weights is None else row('weights', self.weights, above=0)
        if weights is not None and weights.size != len(cutouts):
            raise InvalidTask(f'weights has {weights.size} entries: expected one per cut-out, '
                              f'{len(cutouts)}')
        put(self, cutouts=cutouts, weights=weights, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan; one and two cut-outs are hit exactly, as by `Thread` and `ThreadTwo`."""
        instance('context', context, PlanContext)
        if len(self.cutouts) <= 2:
            return threading_of(self.cutouts, self.depths).solve(context)
        weights = np.ones(len(self.cutouts)) if self.weights is None else self.weights
        return thread_sequence(context.without_obstacles, self.cutouts, weights,
                               depths_on(context.rod.length, self.depths), context.start,
                               context.demands)


def threading_of(cutouts: Sequence[CutOut],
                 depths: ArrayLike | None = None) -> Thread | ThreadTwo | ThreadSequence:
    """Return the task that threads through these cut-outs, one after the other.

    Parameters
    ----------
    cutouts : sequence of CutOut
        One or more.
    depths : array_like, shape (n,), optional
        Arc lengths that have gone through the first one, m, or None.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    cutouts = items('cutouts', cutouts, CutOut, least=1)
    if len(cutouts) == 1:
        return Thread(cutouts[0], depths)
    return ThreadTwo(*cutouts, depths) if len(cutouts) == 2 else ThreadSequence(
        cutouts, None, depths)
