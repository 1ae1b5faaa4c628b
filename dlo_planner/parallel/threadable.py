# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether one cut-out can be threaded, from where, and with what margin: a task of the map."""

from collections.abc import Mapping
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_planner.errors import DeadlineExceeded, Infeasible
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.parallel.cell_grid import CellGrid
from dlo_planner.parallel.pieces import Shared
from dlo_planner.plan.plan import Plan

THREADED, UNDECIDED = 'threaded', 'undecided'
LONGEST = 32      # characters of an outcome
_STANDOFF = 0.1   # of the length: whether there is a way, however quick, does not hang on it
_BETTER = 1e-6    # of stability: a start that is better by less is not preferred to one before it
COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {
    'outcome': (f'<U{LONGEST}', ()), 'amount': (float, ()), 'fraction': (float, ()),
    'clearance': (float, ()), 'stability': (float, ()), 'roll': (float, ()), 'start': (int, ()),
    'gripper': (float, (7,)), 'seconds': (float, ())}


class Question(NamedTuple):
    """The question about every cut-out.

    Attributes
    ----------
    inverse : InverseSimulator
    grid : CellGrid
    starts : tuple of Pose
        Poses of the gripper to begin with; none: only the threading is planned.
    depths : ndarray, shape (n,) or None
        Depths in m, or None.
    patience : float
        Seconds of computing for a plan, after which it is undecided.
    """

    inverse: InverseSimulator
    grid: CellGrid
    starts: tuple[Pose, ...]
    depths: Floats | None
    patience: float


class Batch(NamedTuple):
    """A piece of work: the cut-outs from `begin` up to `end` of a Shared Question."""

    question: Shared
    begin: int
    end: int


def answers(batch: Batch) -> dict[str, NDArray[Any]]:
    """Return the columns of a Batch; this is what workers do."""
    question = batch.question.content
    lines = [answer(question, question.grid.cutout(index))
             for index in range(batch.begin, batch.end)]
    return {name: np.array([line[name] for line in lines], dtype=kind)
            for name, (kind, _) in COLUMNS.items()}


def answer(question: Question, cutout: CutOut) -> dict[str, Any]:
    """Return a line of the map: the best of all starts, or the refusal that came farthest."""
    begun, starts = thread_time(), question.starts or (None,)
    lines = [_from(question, cutout, k, start) for k, start in enumerate(starts)]
    best = lines[0]
    for line in lines[1:]:
        if _rank(line) > _rank(best) + _BETTER:
            best = line
    return best | {'seconds': thread_time() - begun}


def _rank(line: Mapping[str, Any]) -> float:
    """Return a number that is larger the better a line is: threaded, undecided, refused."""
    if line['outcome'] == THREADED:
        return float(2.0 + line['stability'])
    return 1.5 if line['outcome'] == UNDECIDED else line['fraction']


def _from(question: Question, cutout: CutOut, index: int, start: Pose | None) -> dict[str, Any]:
    """Return the line of one start (a Pose or None)."""
    line: dict[str, Any] = {
        'outcome': THREADED, 'amount': 0.0, 'fraction': 0.0, 'clearance': np.nan,
        'stability': np.nan, 'roll': np.nan, 'start': -1 if start is None else index,
        'gripper': np.full(7, np.nan)}
    inverse, patience, prefix = question.inverse, question.patience, ''
    try:
        plan = inverse.thread(cutout, start=start, depths=question.depths, deadline=patience)
        line |= _margins(plan)
        if start is not None:
            prefix = 'start_phase.'
            approach = inverse.approach(cutout, plan, start, deadline=patience, standoff=(
                _STANDOFF * inverse.simulator.rod.length))
            line['stability'] = min(line['stability'], float(approach.stability.min()))
    except Infeasible as refused:
        line |= {'outcome': (prefix + refused.constraint)[:LONGEST], 'amount': refused.amount}
        if not prefix:
            line['fraction'] = 0.0 if refused.plan is None else refused.plan.fraction
    except DeadlineExceeded as error:
        if error.seconds != patience:
            raise  # it is the map's own
        line |= {'outcome': UNDECIDED, 'amount': np.nan}
    return line


def _margins(plan: Plan) -> dict[str, Any]:
    """Return the margins of a Plan and the roll of its first pose."""
    first = plan.grippers[0]
    upright = Pose.looking_along(first.position, first.direction).rotation
    axes = upright.T @ first.rotation
    return {'fraction': plan.fraction, 'clearance': float(plan.clearance.min()),
            'stability': float(plan.stability.min()),
            'roll': float(np.arctan2(axes[2, 1], axes[1, 1])),
            'gripper': np.concatenate([first.position, first.quaternion])}
