# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 5: how far the shape is off with few series terms, benchmarks A and B, 64 elements.

From the true shape of these elements, which has an unknown strain for each, and, as in the paper,
from that of the same series with 32 terms.
"""

import numpy as np

from benchmarks.cases import local, turned, wire
from benchmarks.figures._drawing import COLORS, axes, run, save, ticks
from dlo_planner import DirectSimulator

TERMS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48)
_MASSES = {'A': 0.0, 'B': 1.0}  # kg at the tip
_REFERENCE = 32  # the paper's N_c,ref
_LEAST = 1e-16  # what is drawn of nothing


def shapes(basis, tip_mass):
    """Return N_c -> Shape, as far as they converge."""
    rod = wire(tip_mass=tip_mass)
    found = {terms: DirectSimulator(rod, basis=basis, n_terms=terms, n_elements=64).solve(turned(0))
             for terms in TERMS}
    return {terms: shape for terms, shape in found.items() if shape.converged}


def deviations(basis, tip_mass):
    """Return N_c -> largest distance in m of a node, from the true shape and from the paper's."""
    true = local(rod=wire(tip_mass=tip_mass)).solve(turned(0)).positions
    found = shapes(basis, tip_mass)
    return tuple({terms: float(np.linalg.norm(shape.positions - reference, axis=1).max())
                  for terms, shape in found.items()}
                 for reference in (true, found[_REFERENCE].positions))


def main(folder):
    """Make table and picture."""
    found = {(basis, name): deviations(basis, mass)
             for basis in ('chebyshev', 'fourier') for name, mass in _MASSES.items()}
    figure, both = axes(2, sharey=True)
    for axis, basis in zip(both, ('chebyshev', 'fourier'), strict=True):
        for name in _MASSES:
            true, paper = found[basis, name]
            below = {terms: value for terms, value in paper.items() if terms < _REFERENCE}
            for row, look, text in ((true, 'o-', ''), (below, '.:', f', from {_REFERENCE} terms')):
                axis.loglog(list(row), [max(value, _LEAST) for value in row.values()], look, ms=4,
                            color=COLORS[name], label=f'benchmark {name}{text}')
        axis.set_title(basis, fontsize=10)
        axis.set_xlabel('number of series terms $N_c$')
        ticks(axis, (2, 4, 8, 16, 32))
        axis.legend(fontsize=8, loc='lower left')
    both[0].set_ylabel('largest deviation $\\Delta x_{max}$ [m]')
    rows = {key: pair[0] for key, pair in found.items()}
    lines = [[str(terms), *(f'{row[terms]:.1e}' if terms in row else 'not converged'
                            for row in rows.values())] for terms in TERMS]
    save(figure, folder, 'fig05', 'Fig. 5: deviation by the number of series terms, 64 elements',
         ['N_c', *(f'{basis}, {name} [m]' for basis, name in found)], lines,
         {f'{basis} {name}': row for (basis, name), row in rows.items()}
         | {f'{basis} {name}, from {_REFERENCE} terms': pair[1]
            for (basis, name), pair in found.items()})


if __name__ == '__main__':
    run(main)
