# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The closed loop of a DLO that is held inside: what is in front is estimated, all is moved."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    DloPlannerError,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Thread,
    Trajectory,
    Uncertainty,
)
from dlo_planner.closed_loop import DloEstimator, EstimatorConfig, Feedback, LoopTask, TaskLoop
from dlo_planner.direct.grasp import grasped_at
from dlo_planner.execute.correction_checks import retargeted
from dlo_planner.execute.loop_motions import commanded_of
from dlo_planner.identify import CorrectedTrajectory, Phase
from dlo_planner.identify.correction import correct
from dlo_planner.model.rod import followed_by, part_of_rod
from dlo_planner.rods import GraspedInside

AT = 0.65
ROD = Rod(1.0, 0.045, 0.0147, 0.0118, radius=2.25e-3)
HOLE = CutOut(Pose.looking_along((0.5, 0, 1), (1, 0, 0)), radius=8e-3)
START = Pose.looking_along((0.05, 0.05, 1.05), (1, 0, 0.05))
SEEING = EstimatorConfig(Uncertainty(bending_stiffness=0.05, natural_curvature=0.1,
                                     gripper_position=0.5e-3, gripper_rotation=3e-3),
                         noise=0.5e-3, cutout=3e-3)


def task(obstacles=(), **options):
    """Return the LoopTask through HOLE among obstacles."""
    direct = DirectSimulator(ROD, obstacles=[Sheet.around(HOLE), *obstacles])
    return LoopTask(InverseSimulator(direct), Thread(HOLE, np.linspace(0, 0.1, 4), hold_at=AT),
                    0.04, Limits(0.2, 1.0), **options)


def looked(loop_task, rod):
    """Return the Estimate of the part in front, of a DLO that is another Rod, after some looks."""
    rng, seen = np.random.default_rng(3), DloEstimator(loop_task.front.simulator, SEEING)
    shape = GraspedInside(rod, AT).solve(START)
    for time in np.arange(0.0, 2.0, 0.2):
        seen.gripper(time, START)
        noise = 5e-4 * rng.normal(size=(20, 3))
        seen.look(time, shape.positions_at(rng.uniform(AT, 1, 20)) + noise)
    return seen.estimate


def test_a_rod_is_cut_and_joined_again():
    bent = replace(ROD, natural_curvature=lambda s: (0.3 * s, -0.2), point_masses=((0.3, 0.01),
                                                                                   (0.8, 0.02)),
                   tip_mass=0.003, bending_stiffness=lambda s: 0.0147 * (1 + 0.3 * s))
    whole = followed_by(bent, AT, part_of_rod(bent, AT, 1))
    pose = Pose.looking_along((0, 0, 1), (1, 0.2, 0.1))
    one, other = (GraspedInside(rod, AT, n_elements=40, basis='local').solve(pose)
                  for rod in (bent, whole))
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-8)
    end = Rod(0.3, 0.06, 0.02, 0.016, natural_curvature=(0.5, 0.1), radius=2.25e-3)
    one, other = (DirectSimulator(part, n_elements=40, basis='local').solve(pose) for part in (
        end, part_of_rod(followed_by(ROD, AT, end), AT, 1)))
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-8)
    whole = followed_by(ROD, AT, end)
    assert whole.length == 0.95 and whole.radius == 2.25e-3
    assert part_of_rod(whole, AT, -1).mean_stiffnesses([0, AT])[0] == pytest.approx(
        (0.0118, 0.0147, 0.0147))


def test_what_is_estimated_is_in_front_and_the_rest_is_as_stated():
    loop_task = task()
    estimate = looked(loop_task, replace(ROD, bending_stiffness=0.0162))
    assert estimate.rod.length == pytest.approx(1 - AT)
    simulator = loop_task.simulator(estimate)
    assert simulator.parts[1].rod.stiffness[1] == pytest.approx(estimate.rod.stiffness[1])
    assert simulator.parts[0].rod.stiffness[1] == pytest.approx(0.0147)
    assert estimate.rod.stiffness[1] > 1.03 * 0.0147
    (front, _), (back, _) = loop_task.hanging(estimate, START)
    np.testing.assert_allclose(front.positions[0], back.positions[0], atol=1e-12)
    assert front.s[-1] == pytest.approx(1 - AT) and back.s[-1] == AT
    way, through = loop_task.ways(estimate, START, 0.04)
    assert all(grasped_at(shape) == AT for shape in (*way.shapes, *through.shapes))
    known = loop_task.simulator(estimate).track(through.grippers)
    for one, other in zip(known, through.shapes, strict=True):
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-5)


def test_a_correction_is_judged_with_what_is_behind():
    loop_task, stated = task(), replace(ROD, bending_stiffness=0.0147 * 1.04)
    estimate = looked(loop_task, stated)
    begun = DloEstimator(loop_task.front.simulator, SEEING).estimate
    _, through = loop_task.ways(begun, START, 0.04)
    plan = commanded_of(loop_task.estimated(through), begun)
    found = correct(estimate, plan, inverse=loop_task.front)
    assert found.converged and found.violation == '' and np.abs(found.offsets).max() > 1e-4
    assert loop_task.behind(estimate, found) == ''
    behind = through.shapes[1].positions[20]
    ball = task([Sphere(behind + np.array([0, 0.055, 0]), 0.05)])  # of which the plan stays clear
    assert ball.behind(estimate, found) == ''
    aside = replace(found, grippers=tuple(Pose(pose.position + np.array([0, 6e-3, 0]),
                                               pose.quaternion) for pose in found.grippers))
    assert 'the part of the DLO behind the gripper would be 0.00' in ball.behind(estimate, aside)
    fore = task([Sphere(HOLE.center - np.array([0.1, -0.054, 0]), 0.05)])  # that is not behind
    assert fore.behind(estimate, aside) == ''
    way = CorrectedTrajectory.of(Trajectory(through, tolerance=np.inf), through.shapes[0])
    doubts = [retargeted(loop_task.front, estimate, plan, way, 0.0, way.reached(through.times),
                         None, 0.1, 0.5, behind=judged).doubts
              for judged in (loop_task.behind, lambda *_: 'it is in the way')]
    assert doubts == ['', 'it is in the way']


def test_the_windows_of_a_motion_are_periods_of_both_parts():
    shape = GraspedInside(ROD, AT).solve(START)
    way = CorrectedTrajectory.of(Trajectory(InverseSimulator(DirectSimulator(ROD)).thread(
        HOLE, depths=(0, 0.05), hold_at=AT), tolerance=np.inf), shape)
    slowest = 1 / shape.parts[0].modes(1).frequencies[0]
    assert way.windows[0] == pytest.approx(slowest) and slowest > 2 / shape.parts[1].modes(
        1).frequencies[0]


class Cell:
    """A robot that follows at once, and a DLO in equilibrium, stiffer and more bent than stated."""

    def __init__(self):
        self.rng, self.gripper = np.random.default_rng(0), START
        self.off = np.array([0, 2e-3, -1e-3])
        self.real = GraspedInside(replace(ROD, bending_stiffness=0.0147 * 1.05,
                                          natural_curvature=(0.05, -0.1)), AT)
        self.shape = self.real.solve(START)

    def seen(self):
        """Return points of the part in front, and of the hole's center."""
        self.shape = self.real.track([self.gripper], initial=self.shape)[0]
        points = np.vstack([self.shape.positions_at(self.rng.uniform(AT, 1, 20)),
                            HOLE.center + self.off])
        points += 5e-4 * self.rng.normal(size=points.shape)
        return points[:-1], points[-1]


@pytest.mark.sweep
def test_it_goes_through_the_hole_by_what_is_seen():
    loop_task, cell, time, period = task(), Cell(), 0.0, 0.05
    seen = DloEstimator(loop_task.front.simulator, SEEING)
    loop = TaskLoop(loop_task, seen, START, look=1.0, period=period)
    while loop.phase not in (Phase.DONE, Phase.STOP):
        time += period
        assert time < 60
        seen.gripper(time, cell.gripper)
        loop.gripper(Feedback(cell.gripper, time, stamp=time))
        if seen.due(time):
            points, center = cell.seen()
            seen.hole(HOLE.center, center)
            seen.look(time, points)
        cell.gripper = loop.tick(time) or cell.gripper
        work = loop.work
        if work is not None:
            try:
                loop.finish(work, work())
            except DloPlannerError as error:
                loop.finish(work, error)
    assert loop.phase is Phase.DONE, loop.reason
    shape = cell.real.solve(cell.gripper, cell.shape)
    away = shape.positions_at(np.linspace(AT, 1, 4001)) - HOLE.center - cell.off
    miss = np.linalg.norm(away, axis=1).min()
    assert miss < loop.miss_bound_95 < loop_task.room
    assert loop.aimed is not None  # it was corrected on the way
