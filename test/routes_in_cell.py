# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cable through forks and clips of a board, in the cell's engine.

`python test/routes_in_cell.py [seeds] [first seed] [forks or clips]` plans the routes of
`benchmarks.routes`, and executes them stage by stage in open loop, with a cable and fittings that
are not quite as stated. Forks are walls: two prongs, a floor, and a lid that snaps shut when the
floor bears the `push` of the fork; the cable rubs on them as Coulomb says, not with the friction
that the planner takes. Clips hold what lies in them when their floor bears their push. A run is
done when each fitting has snapped with the cable in it, the cable is in all of them at the end, and
nothing was rammed.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

from benchmarks.routes import board  # noqa: E402
from dlo_planner import (  # noqa: E402
    Box,
    Infeasible,
    InverseSimulator,
    Limits,
    NotConverged,
    Pose,
    Trajectory,
)
from dlo_planner.cell.plant import STEP, Plant  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402
from dlo_planner.tasks import Clip  # noqa: E402

PERIOD = 0.02   # s
CELLS = 80
LONG, THICK, DEEP = 6e-3, 4e-3, 8e-3  # m: a prong along the cable, across it, and out of the floor
LIP = 0.3e-3    # m, below the cable in its seat, and above it when the lid is shut
RUB = 0.2       # Coulomb's coefficient of the walls
RAMMED = 20.0   # N, a force at which a run is given up
LIMITS = Limits(linear_speed=0.1, angular_speed=0.5)
UNKNOWN = Unknowns(0.02, 0.01, natural_curvature=np.array([0.02]), length=3e-4,
                   gripper_position=2e-4, gripper_rotation=1e-3)
FIRMLY = 1.5    # times the push of a fitting, with which it is planned to be pressed into
PLACED = 1e-4   # m, standard deviation of where a fitting is


def walls(fitting, radius, shift):
    """Return prongs, floor and lid of a fitting, as boxes that are displaced by shift (3,), m."""
    axes = np.stack([fitting.pose.rotation[:, 0], fitting.aside, fitting.outwards], axis=1)
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])

    def box(size, y, z):
        center = fitting.pose.position + shift + axes @ np.array([0.0, y, z])
        return Box(Pose.from_rotation(center, axes), size, friction=RUB)

    half = radius + fitting.room
    high = radius + LIP
    prongs = [box((LONG, THICK, DEEP + high), sign * (half + 0.5 * THICK), 0.5 * (DEEP - high))
              for sign in (1.0, -1.0)]
    floor, lid = (box((LONG, 2 * half + THICK, THICK), 0.0, sign * (high + 0.5 * THICK))
                  for sign in (-1.0, 1.0))
    return [*prongs, floor, lid]


def planned(kind, seed):
    """Return the simulator, the task, the plan, and a trajectory of each stage."""
    direct, task, start = board(kind, seed)
    # the engine's clips hold all turns, as the hands do
    task = replace(task, fittings=[replace(one, grip='clamped') if isinstance(one, Clip) else one
                                   for one in task.fittings])
    plan = InverseSimulator(direct).plan(replace(task, fittings=[
        replace(one, push=FIRMLY * one.push) for one in task.fittings]), start=start)
    return direct, task, plan, [Trajectory(stage, LIMITS, tolerance=np.inf)
                                for stage in plan.stage_plans]


def executed(direct, task, plan, motions, seed, unknown=UNKNOWN, placed=PLACED):
    """Return figures of a run, by name."""
    rng = np.random.default_rng([seed, 4627])
    truth, radius = unknown.draw(rng), direct.rod.radius
    shifts = [placed * rng.standard_normal(3) for _ in task.fittings]
    made = [walls(fitting, radius, shift)
            for fitting, shift in zip(task.fittings, shifts, strict=True)]
    clips = [k for k, fitting in enumerate(task.fittings) if isinstance(fitting, Clip)]
    seats = [Pose(task.fittings[k].pose.position + shifts[k], task.fittings[k].pose.quaternion)
             for k in clips]
    holds = {hold.by: hold for hold in plan.shapes[-1].holds}
    plant = Plant(direct.rod, plan.grippers[0], [*direct.obstacles, *sum(made, [])], truth=truth,
                  step=STEP, cells=CELLS, damping=0.1, far_end=task.far_end,
                  fittings=[replace(holds[f'clip {k + 1}'], pose=seat)
                            for k, seat in zip(clips, seats, strict=True)])
    first = len(direct.obstacles)
    for k in range(len(made)):
        plant.put(first + 4 * k + 3, False)  # lids are open
    snapped = dict[int, float]()
    for (name, _), motion in zip(plan.starts, motions, strict=True):
        word, _, of = name.partition(' ')
        k = int(of.split()[-1]) - 1 if of else None
        times, most = PERIOD * np.arange(1, int(motion.duration / PERIOD) + 2), 0.0
        for pose in motion.poses(times):
            plant.move(pose, PERIOD, hands=turning(plant, clips, seats, holds))
            if plant.forces.max() > RAMMED:
                return {'rammed': float(plant.forces.max()), 'at': name}
            if word == 'press' and k not in snapped:
                fitting, bears = task.fittings[k], plant.forces[first + 4 * k + 2]
                most = max(most, bears)
                if bears >= fitting.push and miss(plant, fitting, shifts[k]) < fitting.room + 1e-3:
                    snapped[k] = float(bears)
                    if k in clips:
                        plant.snap(clips.index(k))
                    else:
                        plant.put(first + 4 * k + 3)
        if word == 'press' and k not in snapped:
            return {'did not snap': k + 1, 'bore at most': float(most),
                    'snaps at': task.fittings[k].push,
                    'misses': miss(plant, task.fittings[k], shifts[k])}
    for _ in range(50):
        plant.move(plan.grippers[-1], PERIOD)
    return {'snapped': len(snapped), 'seconds': plant.time,
            'largest force': float(plant.largest_forces.max()),
            'worst miss': max(miss(plant, fitting, shift) for fitting, shift in zip(
                task.fittings, shifts, strict=True))}


def turning(plant, clips, seats, holds):
    """Return where clips that have just snapped turn the cable, by hand: into their seats."""
    out = {}
    for number, (k, seat) in enumerate(zip(clips, seats, strict=True)):
        if number in plant._grasps and number not in getattr(plant, 'turned', set()):
            plant.turned = getattr(plant, 'turned', set()) | {number}
            goal = holds[f'clip {k + 1}'].pose
            out[number] = Pose(seat.position, goal.quaternion)
    return out


def miss(plant, fitting, shift):
    """Return how far the cable is from the middle of a fitting, m."""
    s = np.linspace(0, plant.length, 2001)
    return float(np.linalg.norm(plant.points(s) - fitting.pose.position - shift, axis=1).min())


def is_done(figures, task):
    """Whether each fitting has snapped, and holds the cable in the end."""
    return figures.get('snapped') == len(task.fittings) and figures['worst miss'] < max(
        one.room for one in task.fittings) + 2 * LIP + 1e-3


def main():
    """Execute each route in its own cell."""
    count, first, kind = (*sys.argv[1:], *('8', '0', 'forks')[len(sys.argv) - 1:])
    done = tried = 0
    for seed in range(int(first), int(first) + int(count)):
        try:
            direct, task, plan, motions = planned(kind, seed)
        except Infeasible as error:
            print(f'{kind} {seed}: not planned: {error}', flush=True)
            continue
        tried += 1
        try:
            figures = executed(direct, task, plan, motions, seed)
        except NotConverged as error:
            figures = {'unstable': str(error)}
        good = is_done(figures, task)
        done += good
        print(f'{kind} {seed}: {"done" if good else "NOT done"}', ', '.join(
            f'{name} {value:.4g}' if isinstance(value, float) else f'{name} {value}'
            for name, value in figures.items()), flush=True)
    print(f'{done} of {tried} done')


if __name__ == '__main__':
    main()
