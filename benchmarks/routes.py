# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random routes: three forks with 0.8 mm of room, or a board of five clips.

python -m benchmarks.routes [--seeds 20] [--kinds forks clips] [--samples 20]

Each one is planned, and what was planned is led once more, stage by stage, on elements of half the
length: the DLO has to follow without a leap, in the same shapes, and no fitting may be missed.
Samples of other DLOs, grips and fittings follow it in a hand of 500 N/m: which part gets through.
"""

import argparse
from collections.abc import Iterator
from time import process_time

import numpy as np

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Infeasible,
    InverseSimulator,
    Limits,
    Plan,
    Plane,
    Pose,
    Rod,
    Shape,
    Trajectory,
    Uncertainty,
    robustness,
)
from dlo_planner.tasks import Clip, Fitting, Fork, Route

_ROOM = 0.8e-3  # m
RADIUS = 3e-3   # m
# m: of a fitting's prong along the cable and across it, and how far it stands out of the seat
PRONG = 6e-3, 4e-3, 8e-3
_SIZE = PRONG[0], 2 * (RADIUS + _ROOM + PRONG[1]), 2 * PRONG[2]
_STEEP = 0.6    # rad: beyond level, of the cable at the beginning
_HAND = 500.0   # N/m: how stiff the hand is that leads it
# another cable of its kind, a camera's and a robot's errors
OTHERS = Uncertainty(bending_stiffness=0.2, torsional_stiffness=0.2, mass=0.02, length=1e-3,
                     gripper_position=3e-4, gripper_rotation=5e-3)
_LIMITS = Limits(linear_speed=0.2, angular_speed=1.0)  # of the hand
_APART = 2e-3   # m: how far the cable stays from the board and what stands ahead


def board(kind: str, seed: int) -> tuple[DirectSimulator, Route, Pose]:
    """Return a simulator, the task, and where the gripper begins."""
    rng = np.random.default_rng(seed)
    count = 3 if kind == 'forks' else 5
    height, place, heading = 0.1, np.zeros(2), 0.0
    fittings: list[Fitting] = []
    length = 0.0
    for _ in range(count):
        step, turn = rng.uniform(0.12, 0.2), rng.uniform(-0.4, 0.4)
        heading += 0.5 * turn
        place = place + step * np.array([np.cos(heading), np.sin(heading)])
        heading += 0.5 * turn
        length += step
        # tangents point from the gripper on
        pose = Pose.looking_along((*place, height), (-np.cos(heading), -np.sin(heading), 0.0))
        push = float(rng.uniform(0.05, 0.3))
        fittings.append(
            Fork(pose, push=push, room=_ROOM, size=_SIZE, slip=float(rng.uniform(0.05, 0.5)))
            if kind == 'forks' else Clip(pose, push=push, room=_ROOM, size=_SIZE))
    length = 1.03 * length + rng.uniform(0.25, 0.4)
    rod = Rod(length, float(rng.uniform(0.015, 0.03)), float(rng.uniform(2e-3, 8e-3)), 2e-3,
              radius=RADIUS)
    simulator = DirectSimulator(rod, n_elements=64, basis='local',
                                obstacles=[Plane((0, 0, 0), (0, 0, 1), name='board')])
    # so steep that the cable hangs above all fittings
    along = np.array([np.cos(_STEEP), 0.0, np.sin(_STEEP)])
    start = Pose.looking_along((0.0, 0.0, height) + 0.98 * length * along, -along)
    far_end = FarEnd(Pose.looking_along((0, 0, height), (-1, 0, 0)))
    return simulator, Route(fittings, far_end=far_end, clearance=_APART), start


def led_again(simulator: DirectSimulator, plan: Plan) -> tuple[int, float]:
    """Return how often a DLO of halved elements leaps or is lost, and how far it is off, m."""
    finer = DirectSimulator(simulator.rod, n_elements=128, basis='local')
    leaps, off = 0, 0.0
    shape: Shape | None = None
    for planned in plan.shapes:
        shape = finer.track([planned.gripper], initial=shape, holds=[planned.holds])[0]
        if not shape.converged or shape.jumped:
            leaps += 1
            continue
        away = shape.positions_at(planned.s) - planned.positions
        off = max(off, float(np.linalg.norm(away, axis=1).max()))
    return leaps, off


def runs(kinds: list[str], seeds: range, samples: int) -> Iterator[str]:
    """Yield a line for each route, and one for all of them."""
    for kind in kinds:
        planned, seconds, offs, leaps = 0, list[float](), list[float](), 0
        for seed in seeds:
            simulator, task, start = board(kind, seed)
            begin = process_time()
            try:
                plan = InverseSimulator(simulator).plan(task, start=start)
            except Infeasible as error:
                yield f'{kind} {seed}: {process_time() - begin:.1f} s CPU, refused: {error}'
                continue
            seconds.append(process_time() - begin)
            motion = sum(Trajectory(stage, _LIMITS, tolerance=np.inf).duration
                         for stage in plan.stage_plans)
            again, off = led_again(simulator, plan)
            planned += 1
            leaps += again
            offs.append(off)
            through = 'not asked'
            if samples:
                found = robustness(simulator, plan, OTHERS, fittings=task.fittings,
                                   samples=samples, hand_stiffness=_HAND)
                lost = sum(np.isinf(found.sampled).any(axis=1))
                through = f'{found.success:.2f}, {lost} lost, {process_time() - begin:.0f} s'
            yield (f'{kind} {seed}: {seconds[-1]:.1f} s CPU, {len(plan)} waypoints, '
                   f'{motion:.0f} s of motion, {again} leaps on finer elements, off by '
                   f'{1e3 * off:.2f} mm, clearance {1e3 * plan.clearance.min():.1f} mm, at most '
                   f'{plan.largest_force.max():.2f} N; gets through: {through}')
        yield (f'{kind}: {planned} of {len(seeds)} planned, {leaps} leaps, off by at most '
               f'{1e3 * max(offs, default=0.0):.2f} mm, median '
               f'{np.median(seconds or [np.nan]):.1f} s CPU')


def main() -> None:
    """Print a line for each route."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--samples', type=int, default=0)
    parser.add_argument('--kinds', nargs='+', default=['forks', 'clips'])
    asked = parser.parse_args()
    for line in runs(asked.kinds, range(asked.first, asked.first + asked.seeds), asked.samples):
        print(line, flush=True)


if __name__ == '__main__':
    main()
