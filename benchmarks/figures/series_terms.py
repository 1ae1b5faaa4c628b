# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 5: how far the shape is off with few series terms, benchmarks A and B, 64 elements."""

import numpy as np

from benchmarks.cases import local, turned, wire
from benchmarks.figures.drawing import COLORS, axes, save, ticks
from dlo_planner import DirectSimulator

TERMS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48)
_MASSES = {'A': 0.0, 'B': 1.0}  # kg at the tip


def deviations(basis, tip_mass):
    """Return N_c -> largest distance in m of a node from the shape with a strain per element."""
    rod = wire(tip_mass=tip_mass)
    true = local(rod=rod).solve(turned(0)).positions
    found = {}
    for terms in TERMS:
        shape = DirectSimulator(rod, basis=basis, n_terms=terms, n_elements=64).solve(turned(0))
        if shape.converged:
            found[terms] = float(np.linalg.norm(shape.positions - true, axis=1).max())
    return found


def main(folder):
    """Make table and picture."""
    found = {(basis, name): deviations(basis, mass)
             for basis in ('chebyshev', 'fourier') for name, mass in _MASSES.items()}
    figure, both = axes(2, sharey=True)
    for axis, basis in zip(both, ('chebyshev', 'fourier'), strict=True):
        for name in _MASSES:
            row = found[basis, name]
            axis.loglog(list(row), [max(value, 1e-16) for value in row.values()], 'o-', ms=4,
                        color=COLORS[name], label=f'benchmark {name}')
        axis.set_title(basis, fontsize=10)
        axis.set_xlabel('number of series terms $N_c$')
        ticks(axis, (2, 4, 8, 16, 32))
        axis.legend(fontsize=8)
    both[0].set_ylabel('largest deviation $\\Delta x_{max}$ [m]')
    lines = [[str(terms), *(f'{row[terms]:.1e}' if terms in row else 'not converged'
                            for row in found.values())] for terms in TERMS]
    save(figure, folder, 'fig05', 'Fig. 5: deviation by the number of series terms, 64 elements',
         ['N_c', *(f'{basis}, {name} [m]' for basis, name in found)], lines,
         {f'{basis} {name}': row for (basis, name), row in found.items()})
