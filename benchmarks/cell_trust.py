# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the closed loop does when something goes wrong: wire of 1.5 mm, holes of 5 mm radius.

The task "oblique" is one of soft wires, each with a hole that it passes obliquely as planned.

python -m benchmarks.cell_trust [--tasks thread two ...] [--cases nominal slip ...]
                                [--seeds 0:100] [--jobs 2] [--output trust.jsonl]
python -m benchmarks.cell_trust --cases nominal 'oblique, nominal' 'kink + late stamps' ...
python -m benchmarks.cell_trust --judge trust.jsonl [trust_2.jsonl ...] [--page docs/benchmarks]

Each seed is a task of its own (hole and start), a DLO, gripper, sheet and damping of its own that
differ from what is stated, and its own moment and direction of what happens, see
`dlo_planner.cell.cases`. The driver is the same in all cases and is not told which it is: it knows
the standard deviations of what is unknown, the noise of a camera without second cable or blind
spells, and what is usual of its calibration and of its clock.
Below the table stands what the runs show of each claim, by Clopper and Pearson's bounds with 95 %.
Runs that the output has already are not run again: what was cut off is gone on with.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import combinations, product
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter, process_time
from traceback import format_exc
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks import page, report
from benchmarks.cell.drivers import Driver, Looking
from benchmarks.cell.other_tasks import KINDS, draw_other
from benchmarks.cell.run import Outcome, run
from dlo_planner.cell.camera import BAD
from dlo_planner.cell.cases import CASES, FAULTS, JOINED, NOMINAL, case, strikes_inside
from dlo_planner.cell.tasks import draw_task
from dlo_planner.cell.truth import VERY_UNCERTAIN
from dlo_planner.identify.estimator import EstimatorConfig

DLO, RADIUS = 'wire 1.5', 5e-3
# It knows the deviations of the DLO, of the robot and of the noise; of the camera's own errors and
# of its clock it knows what is usual, the defaults of `EstimatorConfig`
DRIVER = Looking.knowing(
    VERY_UNCERTAIN, BAD, robot_position=NOMINAL.robot_position,
    robot_rotation=NOMINAL.robot_rotation, **{name: getattr(EstimatorConfig(), name) for name in (
        'bias', 'camera_rotation', 'stamps')})
# of the chain of a soft wire, which bends in a small part of its length: within 0.2 mm of the shape
# of 0.36 m with w L^3/EI = 19 where the gripper points 60 degrees upwards, however it is rolled
_SOFT_CELLS = 40
_OF = ', '  # between a task and its case
HEADS = ['case', 'runs', 'happened', 'clean', 'refused before the sheet', 'in it', 'touched',
         'before the hole', 'rammed', 'missed', 'errors', 'covered', 'largest miss [mm]',
         'promised there [mm]', 'struck inside', 'CPU [s]']


def driven(name: str, seed: int, driver: Driver | None = None,
           kind: str = 'thread') -> dict[str, Any]:
    """Return what came of a case and a seed, as what JSON can hold.

    Parameters
    ----------
    name : str
        Name of a case, see `dlo_planner.cell.cases.case`.
    seed : int
    driver : callable, optional
        Driver. If None, the one of the closed loop.
    kind : str, optional
        'thread', or one of `other_tasks.KINDS`.
    """
    disturbances, camera = case(name, seed)
    if driver is None:
        driver = DRIVER
    began = process_time()
    error, outcome = '', Outcome(seed, '')
    try:
        task = draw_task(seed, DLO, RADIUS) if kind == 'thread' else draw_other(
            kind, seed, DLO, RADIUS)
        outcome = run(task, driver, seed=seed, unknowns=VERY_UNCERTAIN,
                      disturbances=disturbances, camera=camera,
                      cells=_SOFT_CELLS if kind == 'oblique' else None)
    except Exception:  # a fault of the driver or the cell: one run of hundreds, which is told
        error = format_exc()
    times = disturbances.times
    known = said(outcome, times)
    if kind in ('insert', 'hold'):  # which touch what they are to touch
        known['clean'] = outcome.threaded and not outcome.rammed
        known['pushes'] = outcome.rammed
    if kind == 'hold' and outcome.threaded:
        known['covered'] = outcome.miss <= outcome.promised
        known['stays'] = [[round(outcome.miss, 6), round(outcome.promised, 6)]]
    return {'case': _row(kind, name), 'seed': seed,
            'event_s': times[0] if times else None,
            'happened': all(time < outcome.time for time in times),
            'cpu_s': round(process_time() - began, 2), 'error': error, **known}


def said(outcome: Outcome, times: Sequence[float] = ()) -> dict[str, Any]:
    """Return an Outcome as what JSON can hold.

    What was promised at the entry is judged for each stay in the hole, unless something happened in
    it, or too shortly before to be seen and to come to rest: at one of the `times` (s).
    """
    struck = [strikes_inside(times, stay.begin, stay.end) for stay in outcome.stays]
    judged = [stay for stay, hit in zip(outcome.stays, struck, strict=True)
              if np.isfinite(stay.promised) and not hit]
    numbers = {name: getattr(outcome, name) for name in ('depth', 'miss', 'promised', 'force',
                                                          'pushed', 'time')}
    return {**{name: value if np.isfinite(value) else None for name, value in numbers.items()},
            **{name: getattr(outcome, name) for name in ('threaded', 'clean', 'touched', 'pushes',
                                                         'rammed', 'refused', 'phase')},
            'stays': [[round(value, 6) for value in (stay.miss, stay.promised)] for stay in judged],
            'covered': all(stay.miss <= stay.promised for stay in judged) if judged else None,
            'struck_inside': any(struck)}


def ended(one: dict[str, Any]) -> str:
    """Return in a few words what came of a run."""
    if one['error']:
        return one['error'].strip().splitlines()[-1]
    how = 'clean' if one['clean'] else 'rammed' if one['rammed'] else (
        'touched' if one['touched'] else one['refused'] or 'missed')
    return how if one['covered'] is not False else f'{how}, by more than promised'


def _pushes(one: dict[str, Any]) -> bool:
    """Return whether a run pushed before the hole; any touch of one that did not tell counts."""
    return bool(one.get('pushes', one['touched']))


def _row(kind: str, name: str) -> str:
    """Return how the table calls a case of a kind of task."""
    return name if kind == 'thread' else f'{kind}{_OF}{name}'


def line(name: str, found: list[dict[str, Any]]) -> list[str]:
    """Return the row of a case under HEADS."""
    def count(*names: str) -> int:
        return sum(all(one[name] for name in names) for one in found)

    judged = [one for one in found if one['covered'] is not None]
    miss, promised = max([stay for one in judged for stay in one['stays']], default=(None, None))
    missed = sum(not any(one[how] for how in ('threaded', 'refused', 'touched', 'error'))
                 for one in found)
    return [name, str(len(found)), str(count('happened')), str(count('clean')),
            str(count('refused') - count('refused', 'depth')), str(count('refused', 'depth')),
            str(count('touched')), str(sum(map(_pushes, found))), str(count('rammed')),
            str(missed), str(count('error')),
            f'{sum(one["covered"] for one in judged)} of {len(judged)}',
            *('-' if value is None else f'{1e3 * value:.2f}' for value in (miss, promised)),
            str(count('struck_inside')),
            f'{np.mean([one["cpu_s"] for one in found]):.1f}']


def table(found: list[dict[str, Any]]) -> str:
    """Return the rows of all cases in Markdown, and below it in what the driver refused."""
    listed = [*CASES, *FAULTS]
    names = [*listed, *sorted({one['case'] for one in found} - {*listed})]
    by_case = {name: [one for one in found if one['case'] == name] for name in names}
    rows = report.markdown(HEADS, [line(name, of_it) for name, of_it in by_case.items() if of_it])
    causes = Counter((one['case'], one['phase'], one['refused'].split(':')[0])
                     for one in found if one['refused'])
    return rows + ''.join(f'\n* {name}: {count} refused in "{phase}", {cause}'
                          for (name, phase, cause), count in sorted(causes.items()))


def claims(found: list[dict[str, Any]]) -> list[tuple[str, int, int, float, bool]]:
    """Return claims: words, runs that are so, all runs, the part wanted, whether at least that."""
    judged = [one for one in found if one['covered'] is not None]
    by_case = {one['case']: [other for other in judged if other['case'] == one['case']]
               for one in judged}
    right = [one for one in found if one['case'] == 'nominal']
    # a push at the entry, or within a second before it, is not a loop's
    unstruck = [one for one in found if not one['struck_inside']]
    out = [('the bound covers the miss, all cases', sum(one['covered'] for one in judged),
            len(judged), 0.95, True),
           ('rammed, all cases', sum(one['rammed'] for one in found), len(found), 0.0, False),
           ('pushed by more than a touch before the hole, unless struck there',
            sum(map(_pushes, unstruck)), len(unstruck), 0.0, False)]
    if right:
        out += [('clean where nothing is wrong', sum(one['clean'] for one in right), len(right),
                 0.99, True),
                ('refused where nothing is wrong', sum(bool(one['refused']) for one in right),
                 len(right), 0.05, False)]
    out += [(f'the bound covers the miss, {name}', sum(one['covered'] for one in of_it),
             len(of_it), 0.95, True) for name, of_it in by_case.items()]
    return out


def verdict(count: int, runs: int, wanted: float, at_least: bool) -> tuple[str, float]:
    """Return 'shown', 'not shown' or 'wrong', and the bound of the part with 95 %.

    That nothing ever happens cannot be shown: there the word is 'none seen'.
    """
    of_it = runs - count if at_least else count  # what should be rare
    rare = 1 - wanted if at_least else wanted
    if not runs:
        return 'not shown', np.nan
    most = float(beta.ppf(0.95, of_it + 1, runs - of_it)) if of_it < runs else 1.0
    least = float(beta.ppf(0.05, of_it, runs - of_it + 1)) if of_it else 0.0
    word = 'wrong' if least > rare else 'shown' if most <= rare else (
        'not shown' if rare or of_it else 'none seen')
    return word, 1 - most if at_least else most


def shown(found: list[dict[str, Any]]) -> str:
    """Return in a line for each claim what the runs show of it."""
    lines = []
    for words, count, runs, wanted, at_least in claims(found):
        word, bound = verdict(count, runs, wanted, at_least)
        side, other = ('least', 'at least') if at_least else ('most', 'at most')
        lines.append(f'* {words}: {count} of {runs}, at {side} {bound:.1%} with 95 %; wanted '
                     f'{other} {wanted:.0%}: {word}')
    return '\n'.join(lines)


def all_driven(every: list[tuple[str, int, None, str]], jobs: int) -> Iterator[dict[str, Any]]:
    """Yield what comes of all arguments of `driven`, as they are done."""
    if jobs == 1:
        yield from (driven(*one) for one in every)
        return
    # a fresh start: a fork could take over locks of threads that it has not
    with ProcessPoolExecutor(jobs, get_context('spawn')) as executor:
        for future in as_completed([executor.submit(driven, *one) for one in every]):
            yield future.result()


def main(arguments: list[str] | None = None) -> int:
    """Run what was asked for, or judge what was; return the exit code of `summarize`."""
    options = _parser().parse_args(arguments)
    if options.judge:
        lines = [line for path in options.judge for line in path.read_text().splitlines()]
        found = [json.loads(line) for line in lines]
        if options.page:
            publish(options.page, lines, found)
        return summarize(found)
    seeds, began, found = range(*map(int, options.seeds.split(':'))), perf_counter(), []
    known = [] if options.output is None or not options.output.exists() else [
        json.loads(line) for line in options.output.read_text().splitlines()]
    have = {(one['case'], one['seed']) for one in known}
    every = [(name, seed, None, kind) for seed in seeds for asked in options.cases
             for kind, name in _meant(asked, options.tasks) if (_row(kind, name), seed) not in have]
    total = len(every)
    for one in all_driven(every, options.jobs):
        found.append(one)
        print(f'{len(found)} of {total} in {perf_counter() - began:.0f} s: {one["case"]} '
              f'{one["seed"]}: {ended(one)}', flush=True)
        if options.output:
            with options.output.open('a') as file:
                file.write(json.dumps(one, allow_nan=False) + '\n')
    return summarize(known + found)


def _meant(asked: str, kinds: list[str]) -> list[tuple[str, str]]:
    """Return kinds of tasks and cases that are meant by a case with or without its kind."""
    kind, comma, name = asked.partition(_OF)
    return [(kind, name)] if comma else [(each, asked) for each in kinds]


def publish(folder: Path, lines: list[str], found: list[dict[str, Any]]) -> None:
    """Keep the runs and their table beside the other results, and write the page anew."""
    kept = report.data_of(folder)
    (kept / 'cell_trust.jsonl').write_text('\n'.join(lines) + '\n')
    (kept / 'cell_trust.md').write_text(
        f'# Threadings in which something goes wrong\n\n{table(found)}\n\n{shown(found)}\n')
    page.write(folder)


def summarize(found: list[dict[str, Any]]) -> int:
    """Print the table and what it shows; return 1 if a claim is wrong, or a run was an error."""
    print(table(found))
    print(shown(found))
    wrong = any(verdict(*one[1:])[0] == 'wrong' for one in claims(found))
    return int(wrong or any(one['rammed'] or one['error'] for one in found))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='benchmarks.cell_trust',
                                     description=__doc__.splitlines()[0])
    every = [*CASES, *FAULTS, *map(JOINED.join, combinations(FAULTS, 2))]
    parser.add_argument('--cases', nargs='+', default=[*CASES, *FAULTS],
                        choices=[*every, *(_row(*both) for both in product(KINDS, every))],
                        metavar='CASE', help=f'of {", ".join([*CASES, *FAULTS])}, or two of the '
                        f'last {len(FAULTS)}, {" + ".join([*FAULTS][:2])!r}; default: each by '
                        f'itself; of one task alone: {_row(KINDS[-1], [*CASES][0])!r}')
    parser.add_argument('--tasks', nargs='+', choices=['thread', *KINDS], default=['thread'],
                        metavar='TASK', help=f'of thread, {", ".join(KINDS)}; default: thread')
    parser.add_argument('--seeds', default='0:100', help='from:to (default: %(default)s)')
    parser.add_argument('--jobs', type=int, default=2, help='processes (default: %(default)s)')
    parser.add_argument('--judge', nargs='+', type=Path, help='outputs, instead of runs')
    parser.add_argument('--page', type=Path, metavar='FOLDER',
                        help='with --judge: keep runs and table, and write this page anew')
    parser.add_argument('--output', type=Path, help='a line of JSON is added for each run')
    return parser


if __name__ == '__main__':
    sys.exit(main())
