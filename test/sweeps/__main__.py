# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random tasks of one kind: what came of each that is not right, and how many of each there are.

python test/sweeps KIND [how many] [seed] [number of depths, where it threads]
"""

import sys
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import numpy as np

# in place of this folder
sys.path[:1] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

KINDS = {  # what yields Outcomes, and its arguments where none are given
    'cutouts': ('cutouts', 200, 0, 20), 'pairs': ('cutouts', 100, 0, 20),
    'sequences': ('cutouts', 16, 0, 100), 'insertions': ('cutouts', 100, 0),
    'contacts': ('contact', 200, 0), 'drags': ('contact', 127, 0), 'falls': ('contact', 150, 0),
    'slides': ('contact', 200, 0), 'rods': ('shapes', 600, 0), 'jumps': ('shapes', 200, 0),
    'held': ('shapes', 24, 1), 'motions': ('motions', 50, 0), 'arms': ('arms', 20, 12)}
RIGHT = ('a minimum', 'away', 'complete', 'confirmed', 'converged', 'converged, a step', 'found',
         'good', 'held', 'inserted', 'jumped', 'replayed', 'right', 'slid')


def tally(outcomes):
    """Print every outcome that is not right, how many there are of each, times and ratios."""
    kinds = defaultdict(list)
    for index, one in enumerate(outcomes):
        kinds[one.what.split(':')[0]].append(one)
        if one.what not in RIGHT:
            print(f'{index}: {one.what} ({one.seconds:.2f} s, estimate / error {one.ratio:.2g})',
                  flush=True)
    print(', '.join(f'{len(those)} {kind}' for kind, those in sorted(kinds.items())))
    print('CPU time: ' + '; '.join(
        f'{kind} {np.median(seconds):.3f} s, at most {np.max(seconds):.2f} s'
        for kind, those in sorted(kinds.items()) if (seconds := [
            one.seconds for one in those if np.isfinite(one.seconds)])))
    ratios = np.array([one.ratio for those in kinds.values() for one in those])
    ratios = ratios[np.isfinite(ratios)]
    if ratios.size:
        low, high = np.quantile(ratios, [0.005, 0.995])
        print(f'{ratios.size} errors: estimate / error {ratios.min():.2f} to {ratios.max():.2f}, '
              f'99 % from {low:.2f} to {high:.2f}')


if __name__ == '__main__':
    kind, *numbers = sys.argv[1:]
    module, *defaults = KINDS[kind]
    given = [int(number) for number in numbers]
    sweep = getattr(import_module(f'sweeps.{module}'), kind)
    tally(sweep(*given, *defaults[len(given):]))
