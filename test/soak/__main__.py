# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The long form: odd messages for minutes, latencies, faults; what is wrong, and all as JSON.

python test/soak [--minutes 10] [--messages 20000] [--seed N] [--output soak_output]

Messages and the examples of properties are others in each run: the seed is printed, and gives the
same ones again.
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from time import monotonic

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / 'test')]
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ.setdefault('ROS_LOG_DIR', mkdtemp(prefix='dlo_planner_log_'))

import numpy as np  # noqa: E402
from domain_coordinator import domain_id  # noqa: E402

from soak.faults import WITH_A_NODE, WITHOUT  # noqa: E402
from soak.fuzzing import NodeEnded, Soak  # noqa: E402
from soak.latencies import BESIDE, RATES, latency  # noqa: E402
from soak.stage import stage  # noqa: E402

ROUND = 500        # messages between two looks
EVERY = 4          # rounds between two executions
LEAST = 50         # messages while one of them runs
LATENCY_TIME = 5.0  # s at each rate
REST = 0.3         # of the time is for latencies and faults


def main():
    """Soak a node; return the number of problems."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=10.0)
    parser.add_argument('--messages', type=int, default=20_000)
    parser.add_argument('--seed', type=int, default=int(np.random.SeedSequence().entropy % 2**32))
    parser.add_argument('--output', type=Path, default=Path('soak_output'))
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    print(f'seed {given.seed}', flush=True)
    found = {'seed': given.seed, 'latencies': [], 'soak': {},
             'faults': faults([(broken_properties, given.seed)])}
    with domain_id() as number:
        os.environ['ROS_DOMAIN_ID'] = str(number)
        with TemporaryDirectory() as directory, stage(Path(directory)) as made:
            for rate in RATES:
                for beside in BESIDE:
                    found['latencies'].append(asdict(latency(made, rate, LATENCY_TIME, beside)))
                made.restore()
            soaked = fuzz(made, given)
            found['soak'] = vars(soaked) | {'growth': soaked.growth()}
            found['faults'] += faults([(one, made) for one in WITH_A_NODE])
        found['faults'] += faults([(one,) for one in WITHOUT])
    (given.output / 'soak.json').write_text(json.dumps(found, indent=1))
    for one in found['latencies']:
        print(f'{one["beside"]}, {one["rate"]:g} poses/s: {one["answered"]} of {one["sent"]} '
              f'answered, {one["median"]:.1f} ms (median), {one["late"]:.1f} ms (99 %)')
    first, *_, last = found['soak']['memory']
    print(f'{sum(found["soak"]["sent"].values())} messages; memory {first[1]:.0f} to {last[1]:.0f} '
          f'MB ({found["soak"]["growth"]:+.1%} since the first minute), descriptors {first[3]} to '
          f'{last[3]}, threads {first[4]} to {last[4]}')
    problems = found['soak']['problems'] + [
        f'{one["fault"]}: {wrong}' for one in found['faults'] for wrong in one['problems']]
    print('\n'.join(problems or ['nothing is wrong']))
    return min(len(problems), 1)


def broken_properties(seed):
    """Return what pytest says of each property that is broken by examples of a seed."""
    told = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-m', 'hypothesis',
         f'--hypothesis-seed={seed}', str(ROOT / 'test')], cwd=ROOT, capture_output=True,
        text=True, check=False, env=os.environ | {'HYPOTHESIS_PROFILE': 'exploring'})
    return [] if told.returncode == 0 else [told.stdout[-4000:]]


def fuzz(made, given):
    """Throw messages for the given time, and at least as many as given; return the Result."""
    soak = Soak(made, np.random.default_rng(given.seed))
    end, number = monotonic() + 60 * given.minutes * (1 - REST), 0
    try:
        while monotonic() < end:
            soak.round(ROUND)
            if number % EVERY == 0:
                soak.execution(LEAST)
            number += 1
            if sum(soak.result.sent.values()) >= given.messages:
                break
    except NodeEnded as ended:
        soak.result.problems.append(str(ended))
    return soak.close()


def faults(wanted):
    """Let faults happen, one after the other; return what was wrong after each."""
    found = []
    for fault, *arguments in wanted:
        begun = monotonic()
        try:
            wrong = fault(*arguments)
        except Exception as error:  # the others are tried all the same
            wrong = [f'{type(error).__name__}: {str(error)[-500:]}']
        found.append({'fault': fault.__name__, 'problems': wrong, 'seconds': monotonic() - begun})
    return found


if __name__ == '__main__':
    sys.exit(main())
