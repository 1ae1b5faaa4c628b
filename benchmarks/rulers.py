# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What others are measured by: the floor at several pieces of work, one solve of the package."""

from functools import cache

import numpy as np

from benchmarks import floor
from benchmarks.cases import ANGLES, local, random_poses, rotations, turned
from benchmarks.timing import Work


def of_floor(poses, warm=False, n=64):
    """Return a Work of the floor: shapes at poses, from the natural one or the one before."""
    wire, bases, work = floor.copper_wire(n), rotations(poses), floor.new_work(n)
    positions, figures = np.empty((len(poses), n + 1, 3)), np.empty((len(poses), 3))
    return Work(lambda: floor.solve_all(wire, bases, warm, work, positions, figures), len(poses))


def floor_step(n=64):
    """Return a Work of the floor: one shape from the one that hangs from 10 degrees less."""
    wire, work = floor.copper_wire(n), floor.new_work(n)
    before, base = rotations([turned(10), turned(20)])
    floor.search(wire, before, work)
    known = work.q.copy()

    def step():
        work.q[:] = known
        floor.search(wire, base, work)

    return Work(step)


@cache
def warm_solve():
    """Return a Work of the package: one shape, by `solve`, from the one 10 degrees before."""
    simulator = local()
    known = simulator.solve(turned(10))
    gripper = turned(20)
    return Work(lambda: simulator.solve(gripper, known))


def _whole(work):
    return Work(work.call)


FLOORS = {
    'warm': floor_step,
    'warm 32': lambda: floor_step(32),
    'cold': lambda: of_floor([turned(0)]),
    'C': lambda: _whole(of_floor([turned(angle) for angle in ANGLES], warm=True)),
    'random': lambda: of_floor(random_poses(50)),
    'random 32': lambda: of_floor(random_poses(50), n=32),
}
