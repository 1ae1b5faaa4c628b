# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A vibration seen in clouds, and the motion that takes it away, in a physics engine's DLO."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('mujoco')

from dlo_planner import DirectSimulator, Limits
from dlo_planner.cell.camera import BAD, Viewer
from dlo_planner.cell.disturbances import UNDISTURBED, Bump
from dlo_planner.cell.plant import Plant
from dlo_planner.cell.robot import Robot
from dlo_planner.cell.tasks import draw_task
from dlo_planner.execute.limiter import frames_of, used
from dlo_planner.execute.loop_motions import Calming
from dlo_planner.identify.vibration import ONE_PERIOD, FreeVibration

PERIOD = 0.02
TASK = draw_task(0, 'wire 1.5', 5e-3)
LATE = {'robot': 0.03, 'stamps': 0.06}  # s, of each stage of the robot, of the stamps


class Swinging:
    """A wire that something bumps into at 0.1 s, before a camera."""

    def __init__(self, robot=0.0, **camera):
        rng = np.random.default_rng(3)
        bump = replace(UNDISTURBED, bumps=(Bump(0.1, 0.01, (0.3, 1.0, 0.5)),))
        self.plant = Plant(TASK.rod, TASK.start, cells=40, step=2e-3, course=bump.draw(rng))
        self.viewer = Viewer(replace(BAD, bias=0.0, **camera), rng)
        self.robot, self.clouds, self.ends = Robot(TASK.start, robot), [], []
        rod = replace(TASK.rod, damping=(0.0, self.plant.lag))
        self.shape = DirectSimulator(rod).solve(TASK.start)

    def pass_by(self, seconds, pose=lambda since: TASK.start):
        """Let time pass, with what the robot is told at each end of a period."""
        self.clouds, self.ends, begin = [], [], self.plant.time
        for count in range(1, round(seconds / PERIOD) + 1):
            self.robot.follow(pose(count * PERIOD))
            self.plant.move(self.robot.moved(begin, PERIOD), PERIOD)
            self.clouds += [(image.stamp, image.points)
                            for image in self.viewer.images(self.plant, TASK.cutout)]
            self.ends.append(self.plant.points([self.plant.length])[0])

    def follow(self, way):
        """Let the robot follow a way, and come to rest."""
        self.pass_by(way.duration + 0.4, lambda since: way.poses([since])[0])

    @property
    def amplitude(self):
        """How far the free end went from its rest, m."""
        return np.linalg.norm(np.ptp(self.ends, axis=0)) / 2

    def seen(self, **known):
        self.pass_by(2.5)
        return FreeVibration.of(self.shape, self.clouds, **known)


def test_frequency_and_amplitude_are_those_of_the_engine():
    cell = Swinging(stamp_error=0.0)
    cell.pass_by(1.0)
    seen = cell.seen()
    assert seen.amplitude == pytest.approx(cell.amplitude, rel=0.1)
    truly = 2 * np.pi * cell.plant.natural_frequencies(2)
    assert seen.rates[:2] == pytest.approx(truly, rel=4 * seen.factor[1])
    assert seen.factor[1] < 0.01
    # where it is half a period later, before damping and errors of the frequency count
    half = np.pi / seen.rates[0]
    ahead = seen.end(seen.after(half + cell.plant.time - seen.stamp))[0]
    before = cell.plant.points([cell.plant.length])[0]
    cell.pass_by(half)
    moved = cell.ends[-1] - before
    assert moved == pytest.approx(
        ahead - seen.end(seen.after(cell.plant.time - half - seen.stamp))[0], abs=1.5e-3)


@pytest.mark.every(2)
@pytest.mark.parametrize('amplitude', [0.0, 5e-4, 3e-3])
def test_an_amplitude_is_told_without_its_noise_and_bounded(amplitude):
    shape, rng = DirectSimulator(TASK.rod).solve(TASK.start), np.random.default_rng(5)
    modes, length, found = shape.modes(2), TASK.rod.length, []
    moved = modes.displacements[0] / np.linalg.norm(modes.displacements[0, -1])
    times = np.arange(0, 1.2 / modes.frequencies[0], 1 / 15)
    for phase in rng.uniform(0, 2 * np.pi, 60):
        clouds = []
        for time in times:
            s = rng.uniform(0.2, 1.0, 20) * length
            swing = amplitude * np.cos(2 * np.pi * modes.frequencies[0] * time + phase)
            off = swing * np.column_stack([np.interp(s, modes.s, part) for part in moved.T])
            clouds.append((time, shape.positions_at(s) + off + 1e-3 * rng.normal(size=off.shape)))
        assert FreeVibration.of(shape, clouds) is None  # a part of a period tells no frequency
        found.append(FreeVibration.of(shape, clouds, periods=ONE_PERIOD).between)
    least, most = np.array(found).T
    assert np.mean(most >= amplitude) >= 0.9  # 95 %, by 60 draws
    assert np.sqrt(np.mean(least**2)) == pytest.approx(amplitude, abs=2.5e-4)
    assert np.median(most) < amplitude + 8e-4


def test_a_vibration_is_taken_away_once_it_is_known_how_late_a_robot_is():
    cell = Swinging(LATE['robot'], stamp_error=LATE['stamps'])
    cell.pass_by(1.0)
    first = cell.seen()
    once = Calming.of(first, cell.plant.time, 0.0, TASK.start, Limits(), PERIOD)
    cell.follow(once.way)
    second = cell.seen(factor=first.factor)
    left = cell.amplitude
    delay = once.delay(second)
    assert delay == pytest.approx(2 * LATE['robot'] + LATE['stamps'], abs=0.04)
    twice = Calming.of(second, cell.plant.time, delay, TASK.start, Limits(), PERIOD)
    cell.follow(twice.way)
    cell.pass_by(1.5)
    assert cell.amplitude < 0.25 * left


def test_the_motion_keeps_limits_and_comes_back():
    cell = Swinging(stamp_error=0.0)
    cell.pass_by(1.0)
    seen = cell.seen()
    for limits, whole in ((Limits(), True), (Limits(0.01, 0.05, linear_jerk=0.5), False)):
        calming = Calming.of(seen, cell.plant.time, 0.0, TASK.start, limits, PERIOD)
        poses = calming.way.poses(np.arange(-0.1, calming.way.duration + 0.1, PERIOD))
        part = used(frames_of(poses), limits, PERIOD)
        assert part <= 0.95 + 1e-9
        assert (part < 0.9) == whole  # else it takes away what it can
        for pose in (poses[0], poses[-1]):
            assert pose.position == pytest.approx(TASK.start.position, abs=1e-12)


def test_a_dlo_at_rest_does_not_vibrate_and_few_clouds_tell_nothing():
    cell = Swinging(stamp_error=0.0)
    rng = np.random.default_rng(5)
    still = [(0.07 * k, cell.shape.positions_at(rng.uniform(0, 1, 20)) + 1e-3 * rng.normal(
        size=(20, 3))) for k in range(36)]
    assert FreeVibration.of(cell.shape, still).amplitude < 0.7e-3
    assert FreeVibration.of(cell.shape, still[:20]) is None  # too short
    near = [(stamp, points[np.linalg.norm(points - TASK.start.position, axis=1) < 0.4])
            for stamp, points in still]
    assert FreeVibration.of(cell.shape, near) is None  # the free end is not seen
