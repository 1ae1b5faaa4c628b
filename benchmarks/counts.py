# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What calls do, counted: the same on every machine, however busy it is.

Times tell whether something got slower on a quiet machine, and nothing in a test. What is counted
here tells it anywhere: a step that is made three times, a solve on a third mesh, a check in Python
on the way of every shape. `python -m benchmarks counts --store` keeps new counts.
"""

import json
import pickle
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import dlo_planner
from benchmarks.rows import Row
from benchmarks.timing import Work
from dlo_planner.direct import equilibrium

KEPT = Path(__file__).parent / 'counts.json'
ALLOWED = 0.05  # of a count: another version of Python
# of Newton steps: on the way down to an oblique edge one processor's rounding takes 985 of them,
# another's 1,172, as contacts that rub come and go in another order
ALLOWED_STEPS = 0.25
_FEW = 2        # of small counts
_PACKAGE = str(Path(dlo_planner.__file__).parent)


class Counts(NamedTuple):
    """What one call of a row does."""

    python: int      # functions of the package that are called, kernels left out
    kernels: int     # kernels that are entered from Python
    iterations: int  # Newton steps of all shapes that are made
    size: int        # bytes of the answer, pickled


def counted(calls: Iterable[Callable]) -> Counts:
    """Return the Counts of some calls together; each is made once before, for what is kept."""
    calls = list(calls)
    for call in calls:
        call()
    kernels = {_place(function.__code__) for function in _kernels()}
    shape = equilibrium.shape_from.__code__
    python = entered = steps = 0

    def look(frame, event, _):
        nonlocal python, entered, steps
        if event != 'call':
            return
        code = frame.f_code
        if _place(code) in kernels:
            entered += 1
        elif code.co_filename.startswith(_PACKAGE) and not code.co_name.startswith('<'):
            python += 1  # (what is in <> is no call any more in Python 3.12)
            if code is shape:
                steps += int(frame.f_locals['end'].iterations)

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        answers = [call() for call in calls]
    finally:
        sys.setprofile(before)
    return Counts(python, entered, steps, len(pickle.dumps(answers)))


def _kernels():
    """Yield the functions of all kernels of the package that are loaded."""
    for name, module in list(sys.modules.items()):
        if name.startswith('dlo_planner'):
            for content in list(vars(module).values()):
                if hasattr(content, 'py_func'):
                    yield content.py_func


def _place(code):
    return code.co_filename, code.co_name


def of_row(row: Row) -> Counts:
    """Return the Counts of a row of the table."""
    prepared = row.make()
    works = [prepared] if isinstance(prepared, Work) else prepared
    return counted(work.call for work in works)


def is_counted(row: Row, words: str = '') -> bool:
    """Return whether a row is a call, has `words` in its name and is not much like another one."""
    return row.make is not None and row.guarded and words in row.name


def differences(before: Counts, now: Counts) -> list[str]:
    """Return what has grown, in words."""
    allowed = Counts(ALLOWED, ALLOWED, ALLOWED_STEPS, ALLOWED)
    return [f'{name}: {new} instead of {old}'
            for name, old, new, more in zip(Counts._fields, before, now, allowed, strict=True)
            if new > max(old * (1 + more), old + _FEW)]


def load() -> dict[str, Counts]:
    """Return row -> Counts that are kept."""
    if not KEPT.exists():
        return {}
    return {name: Counts(**kept) for name, kept in json.loads(KEPT.read_text()).items()}


def store(counts: dict[str, Counts]) -> None:
    """Keep Counts for later runs."""
    KEPT.write_text(json.dumps({name: one._asdict() for name, one in counts.items()},
                               indent=1) + '\n')
