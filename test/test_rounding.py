# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""No answer hangs on a rounding error: everything given is moved by about 1e-16, many times.

Answers may change by what rounding errors grow to in a well-posed task, 1e-9 of the length at
most. Left out are poses at which the DLO is neutral (benchmark C at 90 degrees): there the answer
is one of many, and moves along them by the square root of rounding errors.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.penalties import PositionAt, minimize_penalty
from dlo_planner.tasks import Carry, ThreadInGrasps

THIN = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
BENT = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.6, 0.4), radius=7.5e-4)
SOFT = Rod.circular(1.0, 8e-3, 1500.0, 5e7, 0.4)
CABLE = Rod(1.0, 0.035, 1.2e-3, 1e-3, radius=2e-3)
ON_EDGE = Rod(1.0, 3.0, (1.0, 40.0), 0.5, natural_curvature=(-4.0, 0.0))
FLAT = Rod(1.0, 1.8, (1.0, 100.0), 0.7)
DEPTHS = np.linspace(0, 0.9, 7)
C = [a for a in (*range(0, 181, 10), *range(170, -1, -10))]
ROUNDING = 1e-9


class Exact:
    """Gives what it is asked for."""

    def moved(self, values):
        return np.asarray(values, dtype=float)

    def along(self, position, direction):
        return Pose.looking_along(self.moved(position), self.moved(direction))

    def pose(self, position, rotvec=(0, 0, 0)):
        return Pose(self.moved(position), self.moved(Rotation.from_rotvec(rotvec).as_quat()))

    def hole(self, direction, position=(0.2, 0.1, 1.0)):
        return CutOut(self.along(position, direction), radius=0.01)


class Shaken(Exact):
    """Gives all of it with an error of the size of a rounding error."""

    def __init__(self, seed):
        self._random = np.random.default_rng(seed)

    def moved(self, values):
        values = np.asarray(values, dtype=float)
        size = self._random.choice([1e-16, 3e-16, 1e-15])
        return values + size * self._random.standard_normal(values.shape)


def of_shapes(shapes):
    """Return all that is told of shapes, yes and no as numbers that cannot be overlooked."""
    return np.concatenate([np.concatenate([shape.positions.ravel(),
                                           [shape.jumped, shape.converged]]) for shape in shapes])


def of_plan(plan):
    rooms = np.nan_to_num(plan.clearances, posinf=1e3)
    return np.concatenate([rooms.ravel(), *(gripper.matrix.ravel() for gripper in plan.grippers)])


def turned(given, degrees):
    return given.pose((0, 0, 1), (0, -np.radians(degrees), 0))


def set_down(given, rod, basis):
    simulator = DirectSimulator(rod, basis=basis)
    poses = [(0, 0, 0), (0, -np.pi / 2, 0), (0, -3 * np.pi / 4, 0), (0, -np.pi, 0),
             (np.pi / 2, 0, 0), (np.pi, 0, 0)]
    return of_shapes([simulator.solve(given.pose((0, 0, 0), pose)) for pose in poses])


def benchmark_c(given, rod, basis):
    shapes = DirectSimulator(rod, basis=basis).track([turned(given, angle) for angle in C])
    return of_shapes(np.delete(np.array(shapes, dtype=object), (9, 27)))


def benchmark_c_step_by_step(given, rod, basis):
    simulator, shapes = DirectSimulator(rod, basis=basis), [None]
    for angle in C:
        shapes.append(simulator.solve(turned(given, angle), shapes[-1]))
    return of_shapes(np.delete(np.array(shapes[1:], dtype=object), (9, 27)))


def rolled(given, rod, basis):
    rolls = np.linspace(0, -2 * np.pi, 13)
    return of_shapes(DirectSimulator(rod, basis=basis).track(
        [given.pose((0, 0, 0), (roll, 0, 0)) for roll in rolls]))


def lowered_on(make):
    def task(given, rod, basis):
        simulator = DirectSimulator(rod, basis=basis, obstacles=[make(given)])
        return of_shapes(simulator.track([given.pose((0, 0, z)) for z in (1.0, 0.9, 0.8)]))
    return task


def held(ends, grip):
    def task(given, rod, basis):
        return of_shapes(DirectSimulator(rod, basis=basis).track(
            [given.pose((0, 0, 1))] * len(ends),
            far_ends=[FarEnd(given.pose(end), grip) for end in ends]))
    return task


def threaded(direction):
    def task(given, rod, basis):
        hole = given.hole(direction)
        direct = DirectSimulator(rod, basis=basis, obstacles=[Sheet.around(hole, 3.0, 3.0, 0.0)])
        return of_plan(InverseSimulator(direct).thread(hole, depths=DEPTHS))
    return task


def through_two(given, rod, basis):
    return of_plan(InverseSimulator(DirectSimulator(rod, basis=basis)).thread_two(
        given.hole((1, 0, 0), (0, 0, 1)), given.hole((1, 0, 0), (0.3, 0.05, 0.95)),
        depths=DEPTHS))


def brought_to_the_hole(given, rod, basis):
    hole, inverse = given.hole((1, 0.3, 0)), InverseSimulator(DirectSimulator(rod, basis=basis))
    return of_plan(inverse.approach(hole, inverse.thread(hole, depths=DEPTHS),
                                    given.pose((-1.3, 0.4, 1.2), (0, 0, 2.5)), standoff=0.05))


def inserted(given, rod, basis):
    inverse = InverseSimulator(DirectSimulator(rod, basis=basis))
    return of_plan(inverse.insert(given.hole((1, 0.3, 0)), depths=DEPTHS))


def end_brought_to_a_place(given, rod, basis):
    return minimize_penalty(DirectSimulator(rod, basis=basis),
                            PositionAt(1.0, given.moved((0.6, 0.1, 0.7))),
                            given.pose((0, 0, 1))).gripper.matrix


def carried(given, rod, basis):
    box = Box(given.pose((0, 0, 0.3)), (0.4, 0.1, 0.6))
    task = Carry(given.pose((-0.35, 0.3, 0.6)), given.pose((0.35, 0.3, 0.6)),
                 far_end=FarEnd(given.pose((0.35, -0.3, 0.6))))
    plan = InverseSimulator(DirectSimulator(rod, basis=basis, obstacles=[box])).plan(
        task, start=given.pose((-0.35, -0.3, 0.6)))
    return np.concatenate([of_plan(plan), *(pose.matrix.ravel() for pose in plan.far_end_poses)])


def hand_over_hand(given, rod, basis):
    task = ThreadInGrasps(given.hole((1, 0, 0)), 0.3, given.pose((-0.4, -0.2, 1.0), (0, 1.5, 0)),
                          hold_at=0.8)
    plan = InverseSimulator(DirectSimulator(rod, basis=basis)).plan(task)
    return np.concatenate([plan.depths, *(pose.matrix.ravel() for poses in plan.arms.values()
                                          for pose in poses)])


TASKS = {
    'thin': (THIN, set_down), 'bent': (BENT, set_down),
    'on edge': (ON_EDGE, set_down), 'flat': (FLAT, set_down),
    'C': (THIN, benchmark_c), 'C step by step': (THIN, benchmark_c_step_by_step),
    'snaps': (ON_EDGE, rolled),
    'bar': (THIN, lowered_on(lambda given: Capsule(
        given.moved((0.35, -0.5, 0.7)), given.moved((0.35, 0.5, 0.7)), 0.03))),
    'box': (THIN, lowered_on(lambda given: Box(given.pose((0.4, 0, 0.65)), (0.1, 0.4, 0.1)))),
    'ball': (THIN, lowered_on(lambda given: Sphere(given.moved((0.4, 0, 0.7)), 0.05))),
    'floor': (THIN, lowered_on(lambda given: Plane(given.moved((0, 0, 0.7)),
                                                   given.moved((0, 0, 1))))),
    'clamped': (WIRE, held([(0.8, 0, 1), (0.6, 0, 1)], 'clamped')),
    'pinned': (WIRE, held([(0.7, 0.2, 0.8)], 'pinned')),
    'pushed': (WIRE, held([(0.9995, 0, 1)], 'clamped')),
    'hole along x': (WIRE, threaded((1, 0, 0))), 'hole along y': (WIRE, threaded((0, 1, 0))),
    'oblique hole': (WIRE, threaded((-1, 0.2, -0.5))), 'bent, hole': (BENT, threaded((1, 0.2, 0))),
    'two': (WIRE, through_two), 'start': (WIRE, brought_to_the_hole), 'bore': (WIRE, inserted),
    'penalty': (WIRE, end_brought_to_a_place), 'carry': (SOFT, carried),
    'hand over hand': (CABLE, hand_over_hand),
}


@pytest.mark.every(5)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('task', TASKS)
def test_an_answer_does_not_hang_on_rounding_errors(task, basis):
    rod, does = TASKS[task]
    answer = does(Exact(), rod, basis)
    for seed in range(4):
        np.testing.assert_allclose(does(Shaken(seed), rod, basis), answer, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(('rod', 'roll'), [(ON_EDGE, 0.0), (FLAT, np.pi / 2)])
def test_where_two_sides_are_alike_all_meshes_take_the_same(rod, roll):
    gripper = Exact().pose((0, 0, 0), (roll, 0, 0))
    ends = [DirectSimulator(rod, **how).solve(gripper).positions[-1, 1] for how in (
        {'basis': 'local'}, {'n_elements': 48}, {'n_elements': 150, 'n_terms': 14},
        {'basis': 'fourier', 'n_terms': 20}, {'accuracy': 1e-4})]
    assert np.abs(ends).min() > 0.1
    assert np.all(np.sign(ends) == np.sign(ends[0]))
