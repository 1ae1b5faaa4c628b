# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Freeze answers of today's code, or hold the code against the frozen ones.

python -m benchmarks.oracle check [--jobs N] [--kinds KIND ...] [--sample K]
python -m benchmarks.oracle freeze [--jobs N] [--kinds KIND ...]

`check` ends with 1 where an answer differs. `freeze` finds every answer several times, with
grippers moved by rounding errors: what differs gets a tolerance of its own, or is left out.
"""

import argparse
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from time import perf_counter

from benchmarks.oracle import checking, freezing, frozen
from benchmarks.oracle.kinds import KINDS


def main(arguments=None):
    """Do what was asked for; return the exit status."""
    parser = argparse.ArgumentParser(prog='benchmarks.oracle',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('what', choices=('freeze', 'check'))
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    parser.add_argument('--kinds', nargs='+', choices=tuple(KINDS), default=tuple(KINDS),
                        metavar='KIND', help=', '.join(KINDS))
    parser.add_argument('--sample', type=int, help='so many cases of each kind, quick ones')
    parser.add_argument('--shakes', type=int, default=3, help='how often each case is shaken')
    given = parser.parse_args(arguments)
    begun = perf_counter()
    with ProcessPoolExecutor(given.jobs) if given.jobs > 1 else _One() as pool:
        if given.what == 'freeze':
            freezing.freeze(pool, given.kinds, given.shakes, _commit())
            status = 0
        else:
            known = frozen.load()
            outcome = checking.check(pool, known, checking.chosen(known, given.kinds,
                                                                  given.sample))
            print('\n'.join(checking.table(known, outcome)))
            status = 1 if any(one.differences for one in outcome) else 0
    print(f'{perf_counter() - begun:.0f} s')
    return status


class _One:
    """An executor that does everything itself, at once."""

    map = staticmethod(map)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def _commit():
    """Return the last commit that changed the package, with a plus where more is changed since."""
    def git(*asked):
        return subprocess.run(('git', *asked, '--', 'dlo_planner'), capture_output=True, text=True,
                              check=False).stdout.strip()

    return git('log', '-1', '--format=%h') + '+' * bool(git('status', '--porcelain'))


if __name__ == '__main__':
    sys.exit(main())
