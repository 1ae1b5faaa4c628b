# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading tasks that others published, planned here and run in the independent plant.

python -m benchmarks.deft [--cases 40] [--part grid | narrow] [--output FOLDER]

The grid has the structure of DEFT's threading task (Chen et al. 2025, arXiv 2502.15037): 5 starts,
4 heights, 2 holes; the free end stops 50 mm before the hole, then goes 50 mm past it. Its recorded
starts and holes are not readable without the data, so those here are this file's own. The narrow
holes are 1.4 to 1.1 times as wide as the DLO; 3.5 mm through 4.9 mm, 1.4 times, is the narrowest
that was found in print (Wang, Berenson and Balkcom, ICRA 2015).
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import report
from benchmarks.cell.drivers import OpenLoop, ways
from benchmarks.cell.run import TOUCH, Outcome, run
from dlo_planner import CutOut, Pose, Rod
from dlo_planner.cell.plant import Plant
from dlo_planner.cell.tasks import RODS, Task, draw_task
from dlo_planner.plan.plan import concatenate
from dlo_planner.trajectory.trajectory import Trajectory

FOLDER = Path(__file__).parent.parent / 'docs' / 'benchmarks'
ALIGNED, PAST = 0.05, 0.05  # m: free end before and past the hole

# The bending stiffness is the first guess of DEFT's public code for the branch that is threaded;
# the length is more than twice what its gripper leaves free, which droops by 70 mm.
_DIAMETER, _STIFFNESS, _TWIST = 5e-3, 4e-3, 3e-3  # m, N m^2, N m^2
CABLE = Rod(0.3, 0.03, _STIFFNESS, _TWIST, radius=_DIAMETER / 2)
HOLES = {'A': 0.19, 'B': 0.35}       # m along the board, as in the comments of that code
HEIGHTS = 0.15, 0.25, 0.35, 0.45     # m above the base
RADIUS = 5e-3                        # m, of the holes
_THROUGH = 0.0, 1.0, 0.0             # the board stands in the plane y = 0
STARTS = (((0.27, -0.50, 0.30), (0.0, 1.0, 0.0)),    # places of the gripper and where it looks
          ((0.05, -0.55, 0.45), (0.3, 1.0, -0.2)),
          ((0.50, -0.50, 0.15), (-0.3, 1.0, 0.3)),
          ((0.27, -0.60, 0.55), (0.0, 0.6, -1.0)),
          ((0.20, -0.45, 0.30), (1.0, 0.3, 0.0)))

STRING = Rod.circular(0.1, 3.5e-3, 1200.0, 5e6, 0.49)  # silicone, as thick as the published string
NARROW = {'wire 1.5 mm': RODS['wire 1.5'], 'wire 2 mm': RODS['wire 2'], 'hose': RODS['hose'],
          'string 3.5 mm': STRING}
RATIOS = 1.4, 1.2, 1.1    # diameter of the hole to that of the DLO
_SEED = 1                            # of the narrow holes' directions and starts


@dataclass(frozen=True)
class Case:
    """A Task with a name and, where the free end has to stop before the hole, how far, m."""

    name: str
    task: Task
    aligned: float | None = None


@dataclass(frozen=True)
class Result:
    """What came of a Case.

    Attributes:
        case: Case
        outcome: Outcome in the plant
        aligned: least distance of the free end from where it has to stop before the hole, m
        tips: (n, 3) m, the way of the free end
        seconds: of planning and running
    """

    case: Case
    outcome: Outcome
    aligned: float
    tips: NDArray[np.float64]
    seconds: float

    @property
    def clean(self) -> bool:
        """Whether the DLO is threaded and touched nothing."""
        return self.outcome.threaded and not self.outcome.touched


def grid() -> list[Case]:
    """Return the 40 cases: 5 starts, 4 heights, 2 holes."""
    cases = []
    for number, (place, along) in enumerate(STARTS, 1):
        for height in HEIGHTS:
            for letter, across in HOLES.items():
                hole = CutOut(Pose.looking_along((across, 0.0, height), _THROUGH), radius=RADIUS)
                start = Pose.looking_along(place, along)
                cases.append(Case(f'start {number}, {1e3 * height:.0f} mm, {letter}',
                                  Task('cable', CABLE, hole, start, PAST), ALIGNED))
    return cases


def narrow(ratios: Sequence[float] = RATIOS) -> list[Case]:
    """Return the cases with narrow holes: each DLO through each ratio of the diameters."""
    cases, drawn = [], draw_task(_SEED, 'wire 2')
    for ratio in ratios:
        for name, rod in NARROW.items():
            hole = CutOut(drawn.cutout.pose, radius=ratio * float(np.asarray(rod.radius)))
            scale = rod.length / drawn.rod.length
            away = scale * (drawn.start.position - hole.center)
            start = Pose.from_rotation(hole.center + away, drawn.start.rotation)
            cases.append(Case(f'{name}, {ratio:g}', Task(name, rod, hole, start,
                                                         0.7 * rod.length)))
    return cases


class _Watch:
    """Keeps the way of the free end."""

    def __init__(self) -> None:
        self.tips: list[NDArray[np.float64]] = []

    def __call__(self, plant: Plant) -> None:
        self.tips.append(plant.tip.position.copy())


def tried(case: Case) -> Result:
    """Return the Result of a Case: planned as stated, run in the plant without looking."""
    began, watch, hole = perf_counter(), _Watch(), case.task.cutout
    outcome = run(case.task, OpenLoop(lambda task: Trajectory(concatenate(*ways(
        task, ALIGNED)))), watch=watch)
    tips = np.array(watch.tips).reshape(-1, 3)
    distance = np.nan
    if case.aligned is not None and len(tips):
        stop = hole.center - case.aligned * hole.normal
        distance = float(np.linalg.norm(tips - stop, axis=1).min())
    return Result(case, outcome, distance, tips, perf_counter() - began)


HEADS = ['case', 'hole [mm]', 'room [mm]', 'threaded', 'past the hole [mm]', 'stop missed by [mm]',
         'largest miss [mm]', 'promised [mm]', 'largest force [N]', 'motion [s]', 'computed [s]',
         'refused']


def line(result: Result) -> list[str]:
    """Return the row of a Result under HEADS."""
    task, outcome = result.case.task, result.outcome
    return [result.case.name, f'{2e3 * task.cutout.radius:.3g}', f'{1e3 * task.room:.2f}',
            'yes' if result.clean else 'touched' if outcome.threaded else 'no',
            f'{1e3 * outcome.depth:.1f}', *(_mm(value) for value in (
                result.aligned, outcome.miss, outcome.promised)),
            f'{outcome.force:.2g}', f'{outcome.time:.1f}', f'{result.seconds:.1f}',
            outcome.refused]


def _mm(value: float) -> str:
    return f'{1e3 * value:.2f}' if np.isfinite(value) else '-'


def total(results: list[Result]) -> str:
    """Return the totals in a sentence."""
    clean = sum(result.clean for result in results)
    refused = sum(bool(result.outcome.refused) for result in results)
    worst = max((result.outcome.miss for result in results if result.clean), default=np.nan)
    return (f'{clean} of {len(results)} threaded without touching (forces below {TOUCH} N), '
            f'{refused} refused; largest miss {1e3 * worst:.2f} mm')


def as_json(results: list[Result]) -> dict[str, Any]:
    """Return what JSON can hold of Results."""
    return {result.case.name: {
        'hole_radius_m': result.case.task.cutout.radius, 'room_m': result.case.task.room,
        'clean': result.clean, 'refused': result.outcome.refused,
        'depth_m': result.outcome.depth, 'force_N': result.outcome.force,
        'motion_s': result.outcome.time, 'computed_s': round(result.seconds, 2),
        **{name: value if np.isfinite(value) else None for name, value in (
            ('stop_missed_by_m', result.aligned), ('miss_m', result.outcome.miss),
            ('promised_m', result.outcome.promised))}} for result in results}


def picture(results: list[Result], path: Path) -> None:
    """Draw the ways of the free end and the board, from above and from the side."""
    from matplotlib.figure import Figure  # noqa: PLC0415  for the picture alone
    figure = Figure(figsize=(9, 4.2), layout='constrained')
    panels = figure.subplots(1, 2)
    for panel, (across, label) in zip(panels, ((0, 'along the board [m]'), (2, 'up [m]')),
                                      strict=True):
        for result in results:
            color = 'tab:blue' if result.clean else 'tab:red'
            panel.plot(result.tips[:, 1], result.tips[:, across], color=color, lw=0.7, alpha=0.7)
        holes = {round(result.case.task.cutout.center[across], 6) for result in results}
        edges = [-0.02, *(value + side * RADIUS for value in sorted(holes) for side in (-1, 1)),
                 0.55]
        for low, high in zip(edges[::2], edges[1::2], strict=True):
            panel.plot([0, 0], [low, high], color='k', lw=2.5)
        panel.plot([-ALIGNED] * len(holes), sorted(holes), 'k.', ms=4)
        panel.set(aspect='equal', xlabel='through the board [m]', ylabel=label)
        panel.grid(alpha=0.3)
    panels[0].set_title('ways of the free end, from above', fontsize=10)
    panels[1].set_title('from the side', fontsize=10)
    figure.savefig(path, dpi=110)


def _part(name: str, cases: list[Case], folder: Path, title: str) -> list[Result]:
    """Try cases one after the other; print and write their table."""
    results = []
    for case in cases:
        results.append(tried(case))
        print('  '.join(line(results[-1])), flush=True)
    print(total(results))
    text = report.markdown(HEADS, [line(result) for result in results])
    report.write(folder, name, title, f'{total(results)}.\n\n{text}', as_json(results))
    return results


def main(arguments: list[str] | None = None) -> int:
    """Run it; return 0 if all cases of the grid are threaded without touching."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.deft',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('--cases', type=int, default=40, help='of the grid, evenly picked')
    parser.add_argument('--part', choices=('grid', 'narrow'), help='default: both')
    parser.add_argument('--ratios', type=float, nargs='+', default=list(RATIOS),
                        help='of narrow holes to the DLO (default: 1.4 1.2 1.1)')
    parser.add_argument('--output', type=Path, default=FOLDER)
    given = parser.parse_args(arguments)
    given.output.mkdir(parents=True, exist_ok=True)
    run_part, results = partial(_part, folder=given.output), []
    if given.part != 'narrow':
        cases = grid()
        count = min(max(given.cases, 1), len(cases))
        picked = [cases[k] for k in np.linspace(0, len(cases) - 1, count).round().astype(int)]
        results = run_part('deft', picked, title='# Forty threading tasks')
        picture(results, given.output / 'deft.png')
    if given.part != 'grid':
        for ratio in given.ratios:
            run_part(f'narrow_{ratio:g}', narrow([ratio]),
                     title=f'# Holes {ratio:g} times as wide as the DLO')
    return 0 if all(result.clean for result in results) else 1


if __name__ == '__main__':
    sys.exit(main())
