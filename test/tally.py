# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the scripts with random tasks share: their arguments, CPU times and counts."""

import sys
from collections import Counter
from time import process_time

import numpy as np

from dlo_planner import Infeasible

_GOOD = 'replayed', 'confirmed', 'held', 'inserted', 'converged', 'away'


def arguments(*defaults):
    """Return the whole numbers of the command line, the defaults for those that are not given."""
    given = [int(value) for value in sys.argv[1:]]
    return *given, *defaults[len(given):]


def timed(plan):
    """Return what a function without arguments returns, or its Infeasible; and its CPU time, s."""
    begun = process_time()
    try:
        found = plan()
    except Infeasible as error:
        found = error
    return found, process_time() - begun


def tally(outcomes):
    """Print every outcome that is not as it should be, how many there are, and their CPU times.

    Args:
        outcomes: iterable of ('kind' or 'kind: more', CPU time in s)
    """
    count, seconds = Counter(), {}
    for index, (what, taken) in enumerate(outcomes):
        kind = what.split(':')[0]
        count[kind] += 1
        seconds.setdefault(kind, []).append(taken)
        if what not in _GOOD:
            print(f'{index}: {what} ({taken:.2f} s)', flush=True)
    print(', '.join(f'{number} {kind}' for kind, number in sorted(count.items())))
    print('CPU time: ' + '; '.join(f'{kind} {np.median(taken):.3f} s, at most {max(taken):.2f} s'
                                   for kind, taken in sorted(seconds.items())))
