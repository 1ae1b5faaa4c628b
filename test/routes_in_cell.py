# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cable through forks and clips of a board, in the cell's engine.

`python test/routes_in_cell.py [seeds] [first seed] [forks or clips] [looks]` plans the routes of
`benchmarks.routes`, and executes them stage by stage, with a cable and fittings that are not quite
as stated: in open loop, stiffness known to 2 %; or, with `looks`, in closed loop, stiffness known
to 20 %, where a camera (points with 1 mm of noise) looks at the cable above each fitting. Forks are
walls: two prongs, a floor, and a lid that snaps shut when the floor bears the `push` of the fork;
the cable rubs on them as Coulomb says, not with the friction that the planner takes. Clips hold
what lies in them when their floor bears their push. Where a fitting has snapped the gripper stops
and turns back, as a robot does that feels it. Where the cable is a little longer than stated it
does not snap at the planned pose: then the gripper goes on slowly, as it swung and away from the
fitting, until it does, 6 mm at most, as a robot does that presses. It stops where it feels that it
pulls so much more than planned that the fitting may bear more than it can. A run is done when each
fitting has snapped with the cable in it, the cable is in all of them at the end, and nothing was
rammed: no fitting, nor the cable torn at by its gripper. The cable is led nearly taut, by a hand
under impedance control (500 N/m) that is fed with the planned wrenches of the gripper.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

from benchmarks.routes import board  # noqa: E402
from dlo_planner import (  # noqa: E402
    Box,
    CutOut,
    Hold,
    Infeasible,
    InverseSimulator,
    Limits,
    NotConverged,
    Pose,
    Trajectory,
)
from dlo_planner.cell.camera import GOOD, Viewer  # noqa: E402
from dlo_planner.cell.hand import InHand  # noqa: E402
from dlo_planner.cell.plant import STEP  # noqa: E402
from dlo_planner.cell.robot import nearer  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402
from dlo_planner.execute.pull import pulls_borne  # noqa: E402
from dlo_planner.identify.entries import centered, seen_miss  # noqa: E402
from dlo_planner.model.pose import displaced  # noqa: E402
from dlo_planner.tasks import Clip, Route  # noqa: E402

PERIOD = 0.02   # s
CELLS = 80
LONG, THICK, DEEP = 6e-3, 4e-3, 8e-3  # m: a prong along the cable, across it, and out of the floor
LIP = 0.3e-3    # m, below the cable in its seat, and above it when the lid is shut
RUB = 0.2       # Coulomb's coefficient of the walls
RAMMED = 20.0   # N: a force on a fitting, or of the gripper, at which a run is given up
STOPS = 10      # periods in which the gripper stands before it turns round
TURNS_AT = 2e-3  # m: how far the way back may be from where it does
LIMITS = Limits(linear_speed=0.2, angular_speed=1.0)
UNKNOWN = Unknowns(0.02, 0.01, natural_curvature=np.array([0.02]), length=3e-4,
                   gripper_position=2e-4, gripper_rotation=1e-3)
LESS_KNOWN = replace(UNKNOWN, stiffness=0.2)
FIRMLY = 1.5    # times the push of a fitting, with which it is planned to be pressed into
BEARS = 4.0     # times its push: what a fitting bears
LASTS = 5       # periods: a pull that lasts no longer is that of a cable that swings
ON, MOST_ON = 5e-4, 6e-3  # m: steps in which a gripper presses on, and how far at most
PLACED = 1e-4   # m, standard deviation of where a fitting is
# in closed loop: s until the cable is still, and in which it is looked at; how often at most; how
# near to the middle of a mouth is enough, of its room; periods of a step; s until all is as planned
STILL, LOOKING, LOOKS, NEAR, STEPS, FADES = 0.3, 0.6, 3, 0.25, 15, 1.0
# of what is taken away: by how much that may be wrong where the stiffness is known to 20 %
WRONG = 0.3


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
        replace(one, push=FIRMLY * one.push, bears=BEARS * one.push)
        for one in task.fittings]), start=start)
    return direct, task, plan, [Trajectory(stage, LIMITS, tolerance=np.inf)
                                for stage in plan.stage_plans]


class Run:
    """One run: the plant, and what has snapped with which force, N, by numbers of fittings."""

    def __init__(self, direct, task, plan, seed, unknown=UNKNOWN, placed=PLACED):
        rng = np.random.default_rng([seed, 4627])
        truth, radius = unknown.draw(rng), direct.rod.radius
        self.fittings, self.plan = task.fittings, plan
        self.shifts = [placed * rng.standard_normal(3) for _ in task.fittings]
        made = [wall for fitting, shift in zip(task.fittings, self.shifts, strict=True)
                for wall in walls(fitting, radius, shift)]
        self.clips = [k for k, fitting in enumerate(task.fittings) if isinstance(fitting, Clip)]
        self.goals = {hold.by: hold.pose for hold in plan.shapes[-1].holds}
        self.seats = {k: Pose(task.fittings[k].pose.position + self.shifts[k],
                              self.goals[f'clip {k + 1}'].quaternion) for k in self.clips}
        self.plant = InHand(
            direct.rod, plan.grippers[0], [*direct.obstacles, *made], truth=truth, step=STEP,
            cells=CELLS, damping=0.1, far_end=task.far_end,
            fittings=[Hold(seat, s=0.5 * direct.rod.length) for seat in self.seats.values()])
        self.first = len(direct.obstacles)
        for k in range(len(task.fittings)):
            self.plant.put(self.first + 4 * k + 3, False)  # lids are open
        self.snapped, self.pressed = dict[int, float](), dict[int, float]()
        self.seating = dict[int, Pose]()  # of a clip that snaps, by its number among them
        self.pulled = 0.0  # the largest force of the gripper, N
        self.most = np.inf  # N: the force of the gripper at which a fitting may bear what it can
        self.strong = 0  # periods in which it is more
        self.overloaded: str | None = None  # why the gripper has stopped
        self.twist = np.zeros(6)  # by which poses are displaced from where they were planned
        self.missed = np.zeros(2)  # of the mouth before it, as far as it was seen, m
        self.entry = list[np.ndarray]()  # twists at the waypoints from there on
        self.eyes, self.looks = Viewer(GOOD, np.random.default_rng([seed, 9])), 0

    def move(self, pose, wrench, pressing=None, seconds=PERIOD):
        """Go on to a pose, `pressing` into a fitting; return whether nothing is rammed.

        `wrench` (6,): what is fed forward.
        """
        self.plant.feed(wrench)
        pose = displaced(pose, self.twist)
        self.plant.move(pose, seconds, hands=self.seating)
        self.seating = {}  # a clip that has drawn it into its seat stays there
        if pressing is not None and pressing not in self.snapped:
            k, bears = pressing, float(self.plant.forces[self.first + 4 * pressing + 2])
            self.pressed[k] = max(self.pressed.get(k, 0.0), bears)
            if bears >= self.fittings[k].push and self.miss(k) < self.fittings[k].room + 1e-3:
                self.snapped[k] = bears
                if k in self.clips:
                    self.plant.snap(self.clips.index(k))
                    self.seating = {self.clips.index(k): self.seats[k]}
                else:
                    self.plant.put(self.first + 4 * k + 3)
        self.pulled = max(self.pulled, self.plant.pull)
        strong = (pressing is not None and pressing not in self.snapped
                  and self.plant.pull > self.most)
        self.strong = self.strong + 1 if strong else 0
        if self.strong > LASTS:
            self.overloaded = (f'the gripper pulls with {self.plant.pull:.3g} N: from '
                               f'{self.most:.3g} N on fitting {pressing + 1} may bear too much')
        return max(self.plant.forces.max(), self.plant.pull) < RAMMED

    def look(self, stage, fitting):
        """Look above a mouth, and move so that the cable is where it is to go in."""
        at = stage.stops[0]
        pose, wrench, shape = stage.grippers[at], stage.wrenches[at, 0], stage.shapes[at]
        cutout = CutOut(fitting.pose, radius=fitting.room)
        for _ in range(LOOKS):
            points, begin = [], self.plant.time + STILL
            while self.plant.time < begin + LOOKING:
                self.move(pose, wrench)
                points += [image.points for image in self.eyes.images(self.plant, cutout)
                           if image.stamp >= begin]
            seen = seen_miss(shape, fitting, np.vstack(points))
            self.looks += 1
            if abs(seen.miss[0]) < max(NEAR * fitting.room, seen.error[0]):  # aside
                break
            self.missed = self.missed + seen.miss
            step = centered(shape, fitting, self.missed) - self.twist
            for _ in range(STEPS):
                self.twist = self.twist + step / STEPS
                self.move(pose, wrench)
            if WRONG * abs(seen.miss[0]) < NEAR * fitting.room:
                break  # what is left is near enough, unseen
        # as much is taken away at each further waypoint, where the cable answers otherwise
        self.entry = [centered(one, fitting, self.missed) for one in stage.shapes[at:]]

    def press_on(self, stage, k):
        """Go beyond the farthest pose of a stage, until a fitting snaps, and back."""
        at = stage.stops[0] if stage.stops else len(stage) - 1
        before, top, end = (stage.grippers[i] for i in (at - 1, at, -1))
        pressing, resting = stage.wrenches[[at, -1], 0]
        # it swings on, and pulls: what swings alone may come to the board before it presses
        ways = top.position - before.position, top.position - self.fittings[k].pose.position
        way = sum(one / np.linalg.norm(one) for one in ways)
        way *= ON / np.linalg.norm(way)

        def lead(begin, goal, fed, then, steps):
            for share in np.linspace(0, 1, steps + 1)[1:]:
                self.move(nearer(begin, goal, share), fed + share * (then - fed), k)

        lead(end, top, resting, pressing, 50)
        there = top
        for on in range(1, round(MOST_ON / ON) + 1):
            if k in self.snapped or self.overloaded:
                break
            here, there = there, Pose(top.position + on * way, top.quaternion)
            lead(here, there, pressing, pressing, 10)
        lead(there, end, pressing, resting, 50)

    def bound(self, stage):
        """Bound the force of the gripper while it presses by what the fitting bears."""
        at = stage.stops[0] if stage.stops else len(stage) - 1
        task = Route([replace(one, bears=BEARS * one.push) for one in self.fittings])
        self.most = pulls_borne(task, stage)[at]

    def miss(self, k):
        """Return how far the cable is from the middle of a fitting, m."""
        s = np.linspace(0, self.plant.length, 2001)
        seat = self.fittings[k].pose.position + self.shifts[k]
        return float(np.linalg.norm(self.plant.points(s) - seat, axis=1).min())


def executed(direct, task, plan, motions, seed, looks=False, **unknown):
    """Return figures of a run, by name; `looks`: in closed loop, before each mouth."""
    run = Run(direct, task, plan, seed, **unknown)
    pressed_on = 0
    for (name, _), stage, motion in zip(plan.starts, plan.stage_plans, motions, strict=True):
        k = int(name.split()[-1]) - 1 if name.startswith('press') else None
        times = PERIOD * np.arange(1, int(motion.duration / PERIOD) + 2)
        poses, reached = motion.poses(times), motion.progress(times)
        wrenches = stage.gripper_wrench_at(reached)
        # a stage that presses goes on to its stop, and back until the cable is as slack as before
        back = int(np.searchsorted(reached, stage.times[stage.stops[0]])) if (
            stage.stops and k is not None) else 0
        stands = int(np.searchsorted(reached, stage.times[stage.stops[0]])) if (
            looks and name.startswith('enter')) else -1
        i, moved, run.most = 0, run.twist, np.inf
        if k is not None:
            run.bound(stage)
        while i < len(poses):
            if k is not None:  # the prongs hold it: as it presses it is as planned again
                run.twist = max(0.0, 1 - i * PERIOD / FADES) * moved
            if i == stands:
                run.missed = np.zeros(2)
                run.look(stage, task.fittings[int(name.split()[-1]) - 1])
            elif -1 < stands < i:
                run.twist = np.array([np.interp(reached[i], stage.times[stage.stops[0]:], one)
                                      for one in np.transpose(run.entry)])
            if not run.move(poses[i], wrenches[i], k):
                return {'rammed': float(run.plant.forces.max()), 'pulled': run.pulled, 'at': name}
            if run.overloaded:
                return {'stopped': run.overloaded, 'at': name}
            i += 1
            if i < back and k in run.snapped:  # enough: it stops, and turns round
                away = [np.linalg.norm(one.position - poses[i - 1].position)
                        for one in poses[back:]]
                nearest = int(np.argmin(away))
                if away[nearest] > TURNS_AT:  # it has not begun to pull: it swings on
                    continue
                i = back + nearest
                for _ in range(STOPS):
                    run.move(poses[i], wrenches[i])
        if k is not None and k not in run.snapped:
            run.press_on(stage, k)
            pressed_on += 1
        if run.overloaded:
            return {'stopped': run.overloaded, 'at': name}
        if k is not None and k not in run.snapped:
            return {'did not snap': k + 1, 'bore at most': run.pressed.get(k, 0.0),
                    'snaps at': task.fittings[k].push, 'misses': run.miss(k)}
    for _ in range(50):
        run.move(plan.grippers[-1], plan.wrenches[-1, 0])
    return {'snapped': len(run.snapped), 'pressed on': pressed_on, 'looks': run.looks,
            'seconds': run.plant.time, 'largest force': float(run.plant.largest_forces.max()),
            'pulled': run.pulled, 'planned pull': float(np.linalg.norm(
                [one.gripper_wrench[:3] for one in plan.shapes], axis=1).max()),
            'worst miss': max(run.miss(k) for k in range(len(task.fittings)))}


def is_done(figures, task):
    """Whether each fitting has snapped, and holds the cable in the end."""
    return (figures.get('snapped') == len(task.fittings) and figures['pulled'] < RAMMED
            and figures['worst miss'] < max(one.room for one in task.fittings) + 2 * LIP + 1e-3)


def main():
    """Execute each route in its own cell."""
    count, first, kind, looks = (*sys.argv[1:], *('8', '0', 'forks', '')[len(sys.argv) - 1:])
    done = tried = 0
    for seed in range(int(first), int(first) + int(count)):
        try:
            direct, task, plan, motions = planned(kind, seed)
        except Infeasible as error:
            print(f'{kind} {seed}: not planned: {error}', flush=True)
            continue
        tried += 1
        try:
            figures = executed(direct, task, plan, motions, seed, bool(looks),
                               unknown=LESS_KNOWN if looks else UNKNOWN)
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
