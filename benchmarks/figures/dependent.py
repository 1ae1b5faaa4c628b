# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 12: how much dependent computation gains from more tasks; where there is one to measure.

`dlo_planner.parallel.speculative.speedups(simulator, grippers, dt, tasks)` returns method ->
(number of tasks -> speedup); without it there is no figure.
"""

from importlib import import_module
from importlib.util import find_spec

from benchmarks.cases import chebyshev, turned
from benchmarks.figures.drawing import axes, save

_MODULE = 'dlo_planner.parallel.speculative'
TASKS = (1, 2, 3, 4, 6, 8, 16, 32, 64)


def main(folder):
    """Make table and picture, or say that there is nothing to measure."""
    measure = getattr(import_module(_MODULE), 'speedups', None) if find_spec(_MODULE) else None
    if measure is None:
        print('Fig. 12: no dependent computation in parallel is there to be measured')
        return
    found = measure(chebyshev(32), [turned(angle) for angle in range(0, 90, 3)], 0.02, TASKS)
    figure, (axis,) = axes()
    for name, row in found.items():
        axis.semilogx(list(row), list(row.values()), 'o-', label=name)
    axis.set_xlabel('tasks $N_p$')
    axis.set_ylabel('speedup over one task')
    axis.legend(fontsize=8)
    lines = [[str(n), *(f'{row[n]:.2f}' if n in row else '-' for row in found.values())]
             for n in TASKS]
    save(figure, folder, 'fig12', 'Fig. 12: speedup of a dynamic computation', ['tasks', *found],
         lines, found)
