# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many tasks, one after the other or in parallel, and a table of their outcomes."""

import csv
from collections.abc import Sequence
from concurrent.futures import Executor, as_completed
from os import PathLike
from typing import Any

import numpy as np

from dlo_planner.cell.camera import Camera
from dlo_planner.cell.disturbances import UNDISTURBED, Disturbances
from dlo_planner.cell.drivers import Driver
from dlo_planner.cell.run import STEP, Outcome, run
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import NOTHING_UNKNOWN, Unknowns
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import callback, items
from dlo_planner.progress import OnProgress

HEAD = ('task', 'hole radius [mm]', 'room [mm]', 'threaded', 'depth [m]', 'of [m]',
        'largest miss [mm]', 'promised [mm]', 'chain [mm]', 'touched', 'largest force [N]',
        'time [s]', 'refused')


def bench(tasks: Sequence[Task], driver: Driver, *, unknowns: Unknowns = NOTHING_UNKNOWN,
          disturbances: Disturbances = UNDISTURBED, camera: Camera | None = None,
          damping: float = 0.005, step: float = STEP,
          executor: Executor | None = None, progress: OnProgress = None) -> list[Outcome]:
    """Return the Outcomes of Tasks, in their order; the k-th is run with the seed k."""
    tasks = items('tasks', tasks, Task)
    report = callback('progress', progress) or _silent
    options: dict[str, Any] = {'unknowns': unknowns, 'disturbances': disturbances,
                               'camera': camera, 'damping': damping, 'step': step}
    if executor is None:
        outcomes = []
        for seed, task in enumerate(tasks):
            outcomes.append(run(task, driver, seed=seed, **options))
            report(len(outcomes), len(tasks))
        return outcomes
    futures = [executor.submit(run, task, driver, seed=seed, **options)
               for seed, task in enumerate(tasks)]
    for done, _ in enumerate(as_completed(futures), 1):
        report(done, len(tasks))
    return [future.result() for future in futures]


def rows(tasks: Sequence[Task], outcomes: Sequence[Outcome]) -> list[tuple[Any, ...]]:
    """Return the rows of the table, with the columns HEAD."""
    if len(tasks) != len(outcomes):
        raise InvalidTask(f'outcomes: expected one for each of {len(tasks)} tasks, got '
                          f'{len(outcomes)}')
    return [(task.name, _round(1e3 * task.radius), _round(1e3 * task.room),
             _answer(outcome.threaded), _round(outcome.depth), _round(task.depth),
             _round(1e3 * outcome.miss), _round(1e3 * outcome.promised),
             _round(1e3 * outcome.chain_error), _answer(outcome.touched), _round(outcome.force),
             _round(outcome.time), outcome.refused)
            for task, outcome in zip(tasks, outcomes, strict=True)]


def table(tasks: Sequence[Task], outcomes: Sequence[Outcome], longest: int = 60) -> str:
    """Return the table as text; every entry is cut to `longest` characters."""
    lines = [HEAD] + [tuple(str(value).replace('nan', '-')[:longest] for value in row)
                      for row in rows(tasks, outcomes)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(HEAD))]
    return '\n'.join('  '.join(value.ljust(width) for value, width in zip(
        line, widths, strict=True)).rstrip() for line in lines)


def summary(outcomes: Sequence[Outcome]) -> str:
    """Return the totals of all Outcomes in a sentence."""
    refused = sum(bool(one.refused) for one in outcomes)
    clean = sum(one.threaded and not one.touched for one in outcomes)
    return (f'{len(outcomes)} tasks: {refused} refused, '
            f'{sum(one.threaded for one in outcomes)} threaded, {clean} of them without a touch; '
            f'largest force {max((one.force for one in outcomes), default=0.0):.3g} N')


def write_csv(path: str | PathLike[str], tasks: Sequence[Task],
              outcomes: Sequence[Outcome]) -> None:
    """Write the table to a CSV file."""
    with open(path, 'w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(HEAD)
        writer.writerows(rows(tasks, outcomes))


def _silent(*_: object) -> None:
    pass


def _answer(yes: bool) -> str:
    return 'yes' if yes else 'no'


def _round(value: float) -> float:
    return float(f'{value:.4g}') if np.isfinite(value) else value
