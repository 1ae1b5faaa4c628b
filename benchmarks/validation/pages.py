# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers in sentences of pages of the docs: which figures of the JSON they are."""

import json
from collections.abc import Callable
from typing import Any

from benchmarks.report import DOCS, RESULTS
from benchmarks.said import renewed


def _json(name: str) -> dict[str, Any]:
    """Return what results/benchmarks/NAME.json holds of the benchmark itself."""
    found: dict[str, Any] = json.loads((RESULTS / 'benchmarks' / f'{name}.json').read_text())[name]
    return found


def _slower() -> list[str]:
    """Return how many times as long as Newton's method the paper's take, least and most."""
    found = []
    for method in ('dfp', 'downhill_simplex'):
        ratios = [seconds / times['newton'][size] for times in (_json('fig08'), _json('fig09'))
                  for size, seconds in times[method].items()]
        found += [f'{min(ratios):.0f}', f'{max(ratios):.0f}']
    return found


def _curves(*names: str) -> list[str]:
    """Return deviations from the master curves of the protocols."""
    scripts = json.loads((RESULTS / 'validation' / 'validation.json').read_text())['scripts']
    measures = {one['what']: one['measured']
                for one in scripts['master curves of the protocols']['measures']}
    return [f'{measures[name]:.1e}'.replace('e-0', 'e-') for name in names]


# of each page: a pattern with a group for each number, and what returns these numbers
SAID: dict[str, dict[str, Callable[[], list[str]]]] = {
    'howto/choosing.md': {
        r'they take (\d+) to (\d+) and (\d+) to (\d+) times as long': _slower,
    },
    'protocols.md': {
        r'width and height ([\d.e-]+) L, height / width ([\d.e-]+); with `accuracy=1e-5` '
        r'([\d.e-]+)': lambda: _curves('width, height, default accuracy',
                                       'aspect, default accuracy', 'aspect, accuracy=1e-5'),
        r'bend before they buckle, the linearized equations \| ([\d.e-]+),':
            lambda: _curves('lateral buckling, from SciPy'),
    },
}


def updated(name: str) -> str:
    """Return a page of the docs with the numbers that were measured last.

    Raises:
        ValueError: one of the sentences is not there
    """
    return renewed((DOCS / name).read_text(), SAID[name], name)
