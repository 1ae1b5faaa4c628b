# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 9: computation time by the number of Chebyshev terms, 32 elements."""

from benchmarks.figures._drawing import COLORS, axes, run, save
from benchmarks.figures._timed import METHODS, times

TERMS = (2, 4, 6, 8, 10)
_ELEMENTS = 32


def main(folder):
    """Make table and picture."""
    found = {method: {terms: seconds for (_, terms), seconds in
                      times(method, [(_ELEMENTS, terms) for terms in TERMS]).items()}
             for method in METHODS}
    draw(folder, found)


def draw(folder, found):
    """Write table and picture of method -> (size -> s)."""
    figure, (axis,) = axes()
    for method, row in found.items():
        axis.semilogy(list(row), list(row.values()), 'o-', ms=4,
                      color=COLORS[method], label=METHODS[method])
    axis.set_xlabel('number of series terms $N_c$')
    axis.set_ylabel('CPU time of benchmark C [s]')
    axis.legend(fontsize=8)
    lines = [[str(n), *(f'{row[n]:.3g}' if n in row else '-' for row in found.values())]
             for n in sorted({n for row in found.values() for n in row})]
    save(figure, folder, 'fig09',
         'Fig. 9: benchmark C: time by the number of terms, 32 elements',
         ['N_c', *(f'{METHODS[method]} [s]' for method in found)], lines, found)


if __name__ == '__main__':
    run(main)
