# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 6: how far the shape is off with few elements, benchmark A, 16 Chebyshev terms."""

import numpy as np

from benchmarks.cases import local, turned, wire
from benchmarks.figures._drawing import COLORS, axes, run, save, ticks
from dlo_planner import DirectSimulator

SIZES = (4, 6, 8, 10, 12, 15, 20, 24, 32, 48, 64, 96, 120, 160, 240, 320, 480)
_REFERENCE = 960
_TERMS = 16


def deviations(tip_mass):
    """Return N_L -> largest distance in m of a node from the shape with 960 elements."""
    rod = wire(tip_mass=tip_mass)
    true = local(_REFERENCE, rod).solve(turned(0))
    found = {}
    for n in SIZES:
        shape = DirectSimulator(rod, n_elements=n, n_terms=min(_TERMS, n)).solve(turned(0))
        off = np.linalg.norm(shape.positions - true.positions_at(shape.s), axis=1).max()
        if shape.converged:
            found[n] = float(off)
    return found


def main(folder):
    """Make table and picture."""
    found = {name: deviations(mass) for name, mass in (('A', 0.0), ('B', 1.0))}
    figure, (axis,) = axes()
    for name, row in found.items():
        axis.loglog(list(row), list(row.values()), 'o-', ms=4, color=COLORS[name],
                    label=f'benchmark {name}')
    ends = np.array([12.0, 240.0])
    axis.loglog(ends, found['A'][24] * (24 / ends) ** 2, 'k:', lw=1, label='second order')
    ticks(axis, (4, 8, 15, 32, 64, 120, 240, 480))
    axis.set_xlabel('number of elements $N_L$')
    axis.set_ylabel('largest deviation $\\Delta x_{max}$ [m]')
    axis.legend(fontsize=8)
    lines = [[str(n), *(f'{row[n]:.1e}' if n in row else 'not converged'
                        for row in found.values())] for n in SIZES]
    save(figure, folder, 'fig06',
         'Fig. 6: deviation by the number of elements, 16 Chebyshev terms',
         ['N_L', *(f'{name} [m]' for name in found)], lines, found)


if __name__ == '__main__':
    run(main)
