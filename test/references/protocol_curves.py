# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Master curves of two protocols: aspect of a level cantilever, lateral buckling of a strip.

python test/references/protocol_curves.py docs/pictures/protocols.png
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402
from references.buckling import Planar, critical, level_cantilever  # noqa: E402

G, STRONG = 9.81, 1e4
EDGE = Pose((0, 0, 0), Rotation.from_euler('x', 90, degrees=True).as_quat())
LOADS = 10.0**np.arange(-2, 3.01, 0.25)
TORSIONS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
CLOSED = {'load': ('own weight', 12.854), 'tip': ('load at the tip', 4.0126)}


def aspects(**options):
    """Return (reference, found) (n, 2) of width and height of cantilevers."""
    shapes = [DirectSimulator(Rod(1.0, load / G, 1.0, 0.75), **options).solve(Pose.identity())
              for load in LOADS]
    return (np.array([level_cantilever(load) for load in LOADS]),
            np.array([np.ptp(shape.positions, axis=0)[[0, 2]] for shape in shapes]))


def buckling(kind, torsion):
    """Return the critical load by SciPy and by the package, extrapolated from its stability."""
    reference = critical(lambda load: Planar(**{kind: load}, strong=STRONG), torsion,
                         CLOSED[kind][1] * np.sqrt(torsion) * np.array([0.9, 1.1]))
    factors, found = (0.95, 0.97, 0.99), []
    for factor in factors:
        mass = factor * reference / G
        rod = Rod(1.0, mass if kind == 'load' else 0.0, (1.0, STRONG), torsion,
                  tip_mass=mass if kind == 'tip' else 0.0)
        found.append(DirectSimulator(rod).solve(EDGE).stability)
    zeros = np.roots(np.polyfit(factors, found, 2))
    return reference, reference * zeros[np.argmin(np.abs(zeros - 1))].real


def main(path):
    """Print the deviations and save the picture."""
    from matplotlib.figure import Figure  # noqa: PLC0415  (an extra)

    figure = Figure(figsize=(11.2, 4.2), layout='constrained')
    left, right = figure.subplots(1, 2)
    for options, name, look in (({}, 'default', 'o'), ({'accuracy': 1e-5}, 'accuracy 1e-5', 'x')):
        true, found = aspects(**options)
        off = np.abs(found - true).max(axis=0)
        ratio = found[:, 1] / found[:, 0] * true[:, 0] / true[:, 1] - 1
        print(f'cantilever, {name}: width off by {off[0]:.1e}, height by {off[1]:.1e} L, aspect by '
              f'{np.abs(ratio).max():.1e}')
        left.loglog(LOADS, found[:, 1] / found[:, 0], look, ms=5, mfc='none', label=name)
    left.loglog(LOADS, true[:, 1] / true[:, 0], 'k-', lw=1, label='SciPy')
    left.set(xlabel='w L$^3$ / EI [-]', ylabel='height / width [-]', title='level cantilever')
    line = np.geomspace(0.08, 12, 50)
    for kind, (name, closed) in CLOSED.items():
        pairs = np.array([buckling(kind, torsion) for torsion in TORSIONS])
        print(f'lateral buckling, {name}: off by {np.abs(pairs[:, 1] / pairs[:, 0] - 1).max():.1e}'
              f' of SciPy\'s, {np.abs(pairs[:, 1] / closed / np.sqrt(TORSIONS) - 1).max():.1e} of '
              f'{closed} sqrt(EI GJ)')
        right.loglog(TORSIONS, pairs[:, 1], 'o', ms=5, mfc='none', label=f'{name}, default')
        right.loglog(line, closed * np.sqrt(line), 'k-', lw=1)
    right.set(xlabel='GJ / EI [-]', ylabel='critical w L$^3$ / EI, P L$^2$ / EI [-]',
              title='strip on edge; lines: 12.854 and 4.0126 $\\sqrt{GJ / EI}$')
    for axis in (left, right):
        axis.grid(alpha=0.3, which='both')
        axis.legend(fontsize=8)
        axis.title.set_fontsize(10)
    figure.savefig(path, dpi=110)


if __name__ == '__main__':
    main(sys.argv[1])
