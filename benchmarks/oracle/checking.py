# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Answers of the code as it is, held against the frozen ones."""

import sys
from typing import NamedTuple

from benchmarks.oracle.kinds import KINDS, solved

_SHOWN = 10  # differences of a kind


class Outcome(NamedTuple):
    """A case: its kind and number, what differs (see `Answer.differences`), CPU time in s."""

    kind: str
    number: int
    differences: list
    seconds: float


def chosen(known, kinds, sample=None):
    """Return the (kind, number) of some kinds that are frozen; with `sample` so many of each.

    A sample leaves out the slowest quarter.
    """
    found = []
    for kind in kinds:
        own = [key for key in known.answers if key[0] == kind]
        if sample is not None and own:
            quick = sorted(own, key=known.seconds.get)[:max(sample, 3 * len(own) // 4)]
            own = sorted(quick)[::max(1, len(quick) // sample)][:sample]
        found += own
    return found


def check(pool, known, cases, progress=sys.stderr):
    """Return the Outcomes of some cases, found by the workers of an executor."""
    outcomes = []
    for key, (answer, seconds) in zip(cases, pool.map(_solved, cases), strict=True):
        outcomes.append(Outcome(*key, known.answers[key].differences(answer), seconds))
        if progress is not None and progress.isatty():
            differ = sum(bool(one.differences) for one in outcomes)
            progress.write(f'\r{len(outcomes)} of {len(cases)}: {differ} differ  ({key[0]})'
                           f'{"":20s}')
            progress.flush()
    if progress is not None and progress.isatty():
        progress.write('\n')
    return outcomes


def _solved(key):
    return solved(*key)


def table(known, outcomes):
    """Return the lines of the table of Outcomes, with what differs."""
    made = ', '.join(f'{name} {value}' for name, value in known.made_by.items())
    lines = [f'frozen by {made}', '',
             f'{"kind":26s}{"cases":>7s}{"left out":>10s}{"compared":>10s}{"differ":>8s}'
             f'{"CPU s":>8s}']
    totals = [0] * 4
    for kind in KINDS:
        own = [one for one in outcomes if one.kind == kind]
        if not own:
            continue
        row = [sum(key[0] == kind for key in known.answers),
               sum(key[0] == kind for key in known.left_out), len(own),
               sum(bool(one.differences) for one in own)]
        totals = [a + b for a, b in zip(totals, row, strict=True)]
        lines.append(_line(kind, row, own))
        lines += _said([one for one in own if one.differences])
    return [*lines, _line('all', totals, outcomes)]


def _line(name, row, outcomes):
    seconds = sum(one.seconds for one in outcomes)
    return (f'{name:26s}{row[0]:7d}{row[1]:10d}{row[2]:10d}{row[3]:8d}{seconds:8.1f}')


def _said(different):
    for one in different[:_SHOWN]:
        name, excess, words = max(one.differences, key=lambda found: found[1])
        more = f' and {len(one.differences) - 1} more' if len(one.differences) > 1 else ''
        yield f'    {one.kind} {one.number}: {name} {words}, {excess:.3g} times too far{more}'
    if len(different) > _SHOWN:
        yield f'    and {len(different) - _SHOWN} more cases'
