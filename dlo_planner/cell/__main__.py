# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs tasks in the cell, prints the table, and writes it with a film of one.

python -m dlo_planner.cell --tasks 20 --output cell_output
"""

import argparse
import sys
from argparse import ArgumentParser
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from dlo_planner.cell.bench import bench, summary, table, write_csv
from dlo_planner.cell.camera import BAD, GOOD
from dlo_planner.cell.closed import Looking
from dlo_planner.cell.drivers import OpenLoop, planned
from dlo_planner.cell.run import STEP, run
from dlo_planner.cell.tasks import RODS, draw_task
from dlo_planner.cell.truth import NOTHING_UNKNOWN, UNCERTAIN, VERY_UNCERTAIN

_UNKNOWNS = {'nothing': (NOTHING_UNKNOWN, GOOD), 'much': (UNCERTAIN, GOOD),
             'more': (VERY_UNCERTAIN, BAD)}


def main(args: list[str] | None = None) -> int:
    """Run it; return 0."""
    options = _parser().parse_args(args)
    options.output.mkdir(parents=True, exist_ok=True)
    radius = None if options.radius is None else 1e-3 * options.radius
    tasks = [draw_task(options.seed + k, options.dlo, radius) for k in range(options.tasks)]
    unknowns, camera = _UNKNOWNS[options.unknown]
    open_loop = options.loop == 'open' or options.loop is None and options.unknown == 'nothing'
    settings = {'unknowns': unknowns, 'camera': None if open_loop else camera,
                'damping': options.damping, 'step': options.step}
    print(f'{len(tasks)} tasks, some seconds each', flush=True)
    driver = OpenLoop(planned) if open_loop else Looking.knowing(unknowns, camera)
    # a fresh start: a fork could take over locks of threads that it has not
    with ProcessPoolExecutor(options.workers, get_context('spawn')) as executor:
        outcomes = bench(tasks, driver, executor=executor, progress=partial(_progress, 'tasks'),
                         **settings)
    print(table(tasks, outcomes))
    print(summary(outcomes))
    write_csv(options.output / 'cell.csv', tasks, outcomes)
    shown = max((k for k, one in enumerate(outcomes) if not one.refused), default=None,
                key=lambda k: outcomes[k].threaded)
    if shown is not None and options.film:
        from dlo_planner.cell.film import Film  # noqa: PLC0415  matplotlib is for the film alone
        film = Film()
        run(tasks[shown], driver, seed=shown, watch=film, **settings)
        film.save(options.output / 'cell.gif', tasks[shown])
    print(f'Written to {options.output}: '
          f'{", ".join(sorted(path.name for path in options.output.glob("cell.*")))}')
    return 0


def _parser() -> ArgumentParser:
    parser = argparse.ArgumentParser(prog='python -m dlo_planner.cell', description=__doc__)
    parser.add_argument('--tasks', type=int, default=20)
    parser.add_argument('--seed', type=int, default=0, help='of the first task')
    parser.add_argument('--dlo', choices=list(RODS), help='default: all in turn')
    parser.add_argument('--radius', type=float, help='of the holes in mm; default: 4 to 20')
    parser.add_argument('--unknown', choices=list(_UNKNOWNS), default='nothing',
                        help='how much the planner does not know (default: %(default)s)')
    parser.add_argument('--loop', choices=['open', 'closed'],
                        help='whether the driver looks (default: where something is unknown)')
    parser.add_argument('--damping', type=float, default=0.005, help='ratio (default: %(default)s)')
    parser.add_argument('--step', type=float, default=STEP,
                        help='of the plant in s; shorter ones allow less damping (default: '
                             '%(default)s)')
    parser.add_argument('--workers', type=int, default=2, help='processes (default: %(default)s)')
    parser.add_argument('--no-film', dest='film', action='store_false')
    parser.add_argument('--output', type=Path, default=Path('cell_output'),
                        help='folder (default: %(default)s)')
    return parser


def _progress(what: str, done: int, total: int) -> None:
    """Show how far it is: on one line at a terminal, else line by line."""
    end = '\r' if sys.stdout.isatty() and done < total else '\n'
    print(f'  {what}: {done}/{total}', end=end, flush=True)


if __name__ == '__main__':
    sys.exit(main())
