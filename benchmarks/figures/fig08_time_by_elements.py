# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 8: computation time by the number of elements, 8 Chebyshev terms."""

from benchmarks.figures._drawing import COLORS, axes, run, save, ticks
from benchmarks.figures._timed import METHODS, times
from benchmarks.timing import exponent

SIZES = (16, 32, 64, 96)
_TERMS = 8


def main(folder):
    """Make table and picture."""
    found = {method: {n: seconds for (n, _), seconds in
                      times(method, [(n, _TERMS) for n in SIZES]).items()} for method in METHODS}
    draw(folder, found)


def draw(folder, found):
    """Write table and picture of method -> (size -> s)."""
    figure, (axis,) = axes()
    for method, row in found.items():
        growth = f', grows like $N_L^{{{exponent(list(row), list(row.values())):.2f}}}$'
        axis.loglog(list(row), list(row.values()), 'o-', ms=4,
                    color=COLORS[method], label=METHODS[method] + (growth if len(row) > 1 else ''))
    axis.set_xlabel('number of elements $N_L$')
    axis.set_ylabel('CPU time of benchmark C [s]')
    ticks(axis, SIZES)
    axis.legend(fontsize=7, loc='upper left', bbox_to_anchor=(0.0, 0.82))
    lines = [[str(n), *(f'{row[n]:.3g}' if n in row else '-' for row in found.values())]
             for n in sorted({n for row in found.values() for n in row})]
    save(figure, folder, 'fig08',
         'Fig. 8: benchmark C: time by the number of elements, 8 terms',
         ['N_L', *(f'{METHODS[method]} [s]' for method in found)], lines, found)


if __name__ == '__main__':
    run(main)
