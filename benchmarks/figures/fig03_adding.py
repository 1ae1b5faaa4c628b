# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: two rotation vectors of curvature are added in the plane of n and b."""

import numpy as np

from benchmarks.figures._drawing import plt, run, save

_PARTS = {'I': (1.0, np.radians(15.0)), 'II': (0.8, np.radians(75.0))}  # dw_kappa, q_d


def added(one, other):
    """Return (dw_kappa, q_d) of the sum, by Eq. 14b."""
    (a, alpha), (b, beta) = one, other
    amount = np.sqrt(a * a + b * b + 2 * a * b * np.cos(alpha - beta))
    return amount, np.arctan2(a * np.sin(alpha) + b * np.sin(beta),
                              a * np.cos(alpha) + b * np.cos(beta))


def vector(part):
    """Return the components along n and b."""
    return part[0] * np.array([np.cos(part[1]), np.sin(part[1])])


def main(folder):
    """Make picture and table."""
    total = added(*_PARTS.values())
    one, other = (vector(part) for part in _PARTS.values())
    off = float(np.abs(one + other - vector(total)).max())
    figure, axis = plt.subplots(figsize=(5.6, 4.2), layout='constrained')
    for end, color, label, aside in ((one, 'C0', '$dw_{\\kappa,I}$', (0.1, -0.09)),
                                     (other, 'C1', '$dw_{\\kappa,II}$', (-0.2, 0.05)),
                                     (vector(total), 'k', '$dw_\\kappa$', (-0.1, 0.08))):
        axis.annotate('', end, (0, 0), arrowprops={'arrowstyle': '-|>', 'color': color, 'lw': 2})
        axis.text(*(0.6 * end + aside), label, color=color, fontsize=11)
    axis.plot(*np.array([one, one + other, other]).T, 'k:', lw=1)
    for radius, (_, angle), color, name in ((0.34, _PARTS['I'], 'C0', '$q_{d,I}$'),
                                            (0.22, _PARTS['II'], 'C1', '$q_{d,II}$'),
                                            (0.48, total, 'k', '$q_d$')):
        arc = np.linspace(0, angle, 30)
        axis.plot(radius * np.cos(arc), radius * np.sin(arc), color=color, lw=1)
        axis.text(1.05 * radius, -0.07, name, color=color, fontsize=9, ha='center')
    axis.set(xlim=(-0.15, 1.4), ylim=(-0.15, 1.2), xlabel='along n [rad]', ylabel='along b [rad]')
    axis.set_aspect('equal')
    axis.grid(alpha=0.3)
    save(figure, folder, 'fig03', 'Fig. 3: rotation vectors of two curvatures and their sum',
         ['what', 'found'], [['largest difference of Eq. 14b and the sum of the components about n '
                              'and b, which the package adds', f'{off:.1e}']], {'off': off})


if __name__ == '__main__':
    run(main)
