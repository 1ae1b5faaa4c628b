# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What looking ahead gains (paper, section 4.3.5 and Fig. 12), from counted work.

python benchmarks/speculation.py [picture.png]      the model, 1 to 64 tasks
python benchmarks/speculation.py measure            wall-clock times with two tasks

The scheme is run with every number of tasks, one after the other, and each step's and each look's
work is counted: evaluations of the potential, or Newton steps. A schedule then puts that work on
as many processors: the first one sends what is known to the others, makes the true step, and judges
what it began with; then it takes what the others saw. So the speedups do not depend on the machine;
only the costs of a message and of a Newton step, in evaluations, are set, below.
"""

import os
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent.parent))

from dlo_planner import DirectSimulator, Pose, Rod, parallel  # noqa: E402
from dlo_planner.direct.simulator import motion_by  # noqa: E402
from dlo_planner.parallel.pool import Pool  # noqa: E402
from dlo_planner.progress import Progress  # noqa: E402
from dlo_planner.study.speculation import AheadStepper, Rounds, track_ahead  # noqa: E402

TASKS = (1, 2, 3, 4, 6, 8, 16, 32, 64)
NAMES = {'newton': 'Newton', 'dfp': 'DFP', 'downhill_simplex': 'simplex'}
NEWTON_STEP = 4.0  # evaluations with gradient; measured once: 18 us beside 5.7 us
MESSAGE = 5.0      # the same, assumed for a task or a result; packing and unpacking: 96 and 10 us
MESH = {'n_elements': 32, 'n_terms': 4}
SMALL = {'n_elements': 16, 'n_terms': 2}  # for the simplex, which is slow


class Here(Executor):
    """Does everything at once, here."""

    def submit(self, function, /, *arguments):
        """Return a Future that has its result."""
        future = Future()
        future.set_result(function(*arguments))
        return future


class FromTheShapeBefore(AheadStepper):
    """Begins each step's search where the DLO is, as the paper does."""

    def guess(self, before, dt):
        """Return the strains of now."""
        return before.row.bends[0].copy()


def mesh_of(method):
    """Return the options of the mesh with which a method is looked at."""
    return SMALL if method == 'downhill_simplex' else MESH


def turned(degrees):
    """Return the gripper of benchmark C."""
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def wire(**more):
    """Return the paper's copper wire."""
    return Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, **more)


def moving(method, tasks, make):
    """Return the Rounds of benchmark C in motion: 180 degrees and back in 4 s, steps of 0.05 s."""
    way = [turned(90 * (1 - np.cos(np.pi * k / 40))) for k in range(81)]
    rounds = Rounds(Pool(Here(), lambda: None), tasks)
    motion = motion_by(partial(make, rounds, 80), DirectSimulator(
        wire(damping=(0.5, 0.0)), method=method, **mesh_of(method)), way, 0.05, Progress(),
        tolerance=np.inf, integrator='paper')
    assert motion.converged, motion.message
    return rounds.made


def yielding(method, tasks):
    """Return the Rounds of benchmark C of a soft wire that yields, moved slowly.

    In steps of 3 degrees; the simplex, which is slow, in steps of 10.
    """
    step = 10 if method == 'downhill_simplex' else 3
    way = [turned(angle) for angle in [*range(0, 181, step), *range(180 - step, -1, -step)]]
    rounds = Rounds(Pool(Here(), lambda: None), tasks)
    simulator = DirectSimulator(wire(yield_stress=60e6, hardening=0.01), method=method,
                                **mesh_of(method))
    shapes = track_ahead(simulator, rounds, way, None, Progress())
    assert all(shape.converged for shape in shapes)
    return rounds.made


def seconds_of(made, newton, message):
    """Return how long rounds take on a processor for each task, in the unit of their work.

    Args:
        made: Rounds' lines
        newton, message: costs of a Newton step of judging, and of a task or of a result
    """
    total = 0.0
    for one in made:
        sent = message * (1 + np.arange(len(one.ahead)))  # one after the other
        free = message * len(one.ahead) + one.work + newton * one.judging
        for ready in np.sort(sent + np.array(one.ahead)):  # results are taken as they come
            free = max(free, ready) + message
        total += free
    return total


def speedups(recorded, method, ideal):
    """Return a list of (tasks, speedup, part of the guesses that were used).

    Args:
        recorded: Rounds' lines by tasks
        ideal: whether messages and judging cost nothing
    """
    newton, message = NEWTON_STEP, MESSAGE
    if method == 'newton':  # its unit of work is a step
        newton, message = 1.0, MESSAGE / NEWTON_STEP
    if ideal:
        newton = message = 0.0
    times = {tasks: seconds_of(made, newton, message) for tasks, made in recorded.items()}
    return [(tasks, times[1] / times[tasks], np.mean([one.guess == 'used' for one in made]))
            for tasks, made in recorded.items()]


CASES = {
    'in motion, from the shape before (the paper\'s)': partial(moving, make=FromTheShapeBefore),
    'in motion, from where it would go by itself': partial(moving, make=AheadStepper),
    'yielding, moved slowly': yielding}


def table():
    """Print all speedups; return them by case, method, and whether messages cost nothing."""
    found = {}
    for case, run in CASES.items():
        for method, name in NAMES.items():
            recorded = {tasks: run(method, tasks) for tasks in TASKS}
            for ideal in (True, False):
                lines = speedups(recorded, method, ideal)
                found[case, name, ideal] = lines
                print(f'{case}: {name}{", free messages and judging" if ideal else ""}')
                print('  tasks   ' + ' '.join(f'{tasks:5d}' for tasks, _, _ in lines))
                print('  speedup ' + ' '.join(f'{gain:5.2f}' for _, gain, _ in lines))
                print('  used    ' + ' '.join(f'{100 * used:4.0f}%' for _, _, used in lines),
                      flush=True)
    return found


def draw(found, path):
    """Save the picture: speedup over the number of tasks."""
    from matplotlib.figure import Figure  # noqa: PLC0415  (an extra)

    figure = Figure(figsize=(13, 4.2), layout='constrained')
    for axes, case in zip(figure.subplots(1, len(CASES), sharey=True), CASES, strict=True):
        for name, color in zip(NAMES.values(), ('tab:green', 'tab:blue', 'tab:orange'),
                               strict=True):
            for ideal, style in ((False, '-o'), (True, ':')):
                tasks, gains, _ = zip(*found[case, name, ideal], strict=True)
                axes.plot(tasks, gains, style, color=color, ms=3,
                          label=name + (', free messages and judging' if ideal else ''))
        axes.set(title=case, xlabel='tasks $N_p$', xscale='log')
        axes.set_xticks(TASKS, TASKS, minor=False)
        axes.set_xticks([], minor=True)
        axes.axhline(1.0, color='0.7', lw=0.8)
        axes.grid(alpha=0.3)
    figure.axes[0].set(ylabel='speedup', ylim=(0, 1.05 * max(
        gain for lines in found.values() for _, gain, _ in lines)))
    figure.axes[0].legend(fontsize=7)
    figure.savefig(path, dpi=110)


def measure():
    """Print wall-clock and CPU times of two tasks beside those of one."""
    way = [turned(90 * (1 - np.cos(np.pi * k / 40))) for k in range(81)]
    for case, rod, dt in (('in motion', wire(damping=(0.5, 0.0)), 0.05),
                          ('yielding', wire(yield_stress=60e6, hardening=0.01), None)):
        for method, name in NAMES.items():
            simulator = DirectSimulator(rod, method=method, **mesh_of(method))
            more = {} if dt is None else {'integrator': 'paper', 'tolerance': np.inf}
            parallel.speculative(simulator, way[:4], dt, Here(), tasks=2, **more)  # compiles
            for what, make in (('serial', None), ('thread', partial(ThreadPoolExecutor, 1)),
                               ('process', partial(ProcessPoolExecutor, 1,
                                                   mp_context=get_context('fork')))):
                wall, cpu = perf_counter(), process_time()
                parallel.speculative(simulator, way, dt, make, tasks=2, **more)
                print(f'{case}, {name}, {what}: {1e3 * (perf_counter() - wall):.0f} ms, CPU here '
                      f'{1e3 * (process_time() - cpu):.0f} ms, load {os.getloadavg()[0]:.1f}',
                      flush=True)


if __name__ == '__main__':
    if sys.argv[1:] == ['measure']:
        measure()
    else:
        results = table()
        if sys.argv[1:]:
            draw(results, sys.argv[1])
