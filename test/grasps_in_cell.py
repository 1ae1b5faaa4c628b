# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A USB cable of 1 m through a level hole of 16 mm, hand over hand, in the cell's engine.

`python test/grasps_in_cell.py [seeds] [first seed] [pulls] [loose]` plans it once, makes each stage
calm, and executes them in open loop with what is not known: stiffness, weight and bends of the
cable, where the hole and what feeds the cable are, how both arms are calibrated. A hand that closes
takes the cable as it is there. Done is what touched nothing and passed in full. `loose`: 1 of a
cable that nothing feeds: what held its beginning lets go once the first hand holds it.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

from scipy.spatial.transform import Rotation  # noqa: E402

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Limits,
    NotConverged,
    Pose,
    Rod,
    Sheet,
    Trajectory,
)
from dlo_planner.cell.plant import STEP, TOUCH, Plant  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402
from dlo_planner.tasks import ThreadInGrasps  # noqa: E402

CABLE = Rod(1.0, 0.035, 1.2e-3, 1.0e-3, radius=2e-3, damping=0.02)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=8e-3)
SHEET = Sheet.around(HOLE, 0.3, 0.3, 1e-3)
FEED = Pose.looking_along((-0.25, -0.2, 1.0), (0, 0, -1))
LENGTH = 0.5
PERIOD = 0.02  # s
WAIT = 1.0     # s at rest before a hand opens or closes: the person or robot that does it
CELLS = 80  # the hands hold at multiples of a cell
JAWS = 0.01    # m: a hand that opens 20 mm catches what is nearer to its middle
# standard deviations as those of a plan that were tried before (`docs/validation/plans.md`): 2 % of
# stiffness, 1 % of weight, bends of 0.02 1/m, 0.3 mm of length; feed, hole and hands 0.2 mm off,
# feed and hands turned by 1 mrad
SHIFT, TURN = 2e-4, 1e-3
UNKNOWN = Unknowns(0.02, 0.01, natural_curvature=np.array([0.02]), length=3e-4,
                   gripper_position=SHIFT, gripper_rotation=TURN, hole_position=SHIFT)


class Loose(Plant):
    """A cable whose beginning hangs freely once the first of the hands holds it."""

    is_loose = False

    def let_go(self):
        """Let the cable hang from the first hand alone, and come to rest."""
        model, data, cell = self._model, self._data, self.length / CELLS
        mass = 0.5 * cell * CABLE.mass_per_length * self.truth.mass
        self.is_loose = True
        model.body_mass[1], model.body_gravcomp[1] = mass, 0.0
        model.body_ipos[1] = 0.25 * cell, 0.0, 0.0
        model.body_inertia[1] = mass * cell**2 / 12
        mujoco.mj_setConst(model, mujoco.MjData(model))
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.timestep = 2e-3
        model.dof_damping[6:] = self.lag * self._stiffness
        for _ in range(10_000):
            mujoco.mj_step(model, data)
            data.qvel *= 0.98  # slower than the engine's own steps
            if np.abs(data.qvel).max() < 1e-4:
                break
        else:
            raise NotConverged('the cable does not come to rest in the first hand')
        data.qvel[:] = 0
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        mujoco.mj_forward(model, data)

    def _advance(self, place, quaternion, twist):
        if not self.is_loose:
            super()._advance(place, quaternion, twist)
            return
        mujoco.mj_step(self._model, self._data)
        if self._data.ncon:
            self._feel()


def simulator():
    return DirectSimulator(CABLE, basis='local', n_elements=100, obstacles=[SHEET])


def planned(pulls=1, loose=False):
    """Return the plan, and a calm trajectory of each stage; None of one that does not move."""
    direct = simulator()
    first = 0.175 - 0.05  # of the length passes when the free end is threaded
    stroke = (LENGTH - first) / pulls * (1 + 1e-3)
    plan = InverseSimulator(direct).plan(ThreadInGrasps(
        HOLE, LENGTH, None if loose else FEED, stroke=stroke, begins_free=loose))
    limits = Limits(linear_speed=0.1, angular_speed=0.5)
    return plan, [Trajectory(stage, limits, simulator=direct) if stage.arms else None
                  for stage in plan.stage_plans]


def executed(plan, motions, seed, unknown=UNKNOWN, arms=(SHIFT, TURN)):
    """Return figures of a run, by name."""
    rng = np.random.default_rng([seed, 4613])
    truth = unknown.draw(rng)
    wrong = {name: (arms[0] * rng.standard_normal(3), Rotation.from_rotvec(
        arms[1] * rng.standard_normal(3)).as_matrix()) for name in ('first', 'second')}

    def true(name, pose):  # each arm was taught at the hole
        shift, turn = wrong[name]
        return Pose.from_rotation(HOLE.center + turn @ (pose.position - HOLE.center) + shift,
                                  turn @ pose.rotation)

    closing = [plan.shapes[0].holds[0], *(one.hold for one in plan.events if one.kind == 'close')]
    start = closing[0]
    loose = not plan.shapes[0].gripper_wrench.any()
    plant = (Loose if loose else Plant)(
        CABLE, FEED, [SHEET], truth=truth, step=STEP, cells=CELLS, damping=0.02, hands=[
            type(start)(true('first', start.pose), s=start.s, by=start.by), *closing[1:]])
    if isinstance(plant, Loose):
        plant.let_go()
    plant.close(0, true('first', start.pose))
    closed, count, figures = {'first': 0}, 1, {'caught': 0.0, 'fell': 0.0}
    least = np.inf
    for k, motion in enumerate(motions):
        for event in (one for one in plan.events if one.stage == k):
            rest(plant, WAIT)
            if event.kind == 'close':
                figures['caught'] = max(figures['caught'], plant.close(
                    count, true(event.arm, event.hold.pose)))
                closed[event.arm], count = count, count + 1
            else:
                before = plant.points(np.linspace(0, 1, 41) * plant.length)
                plant.open(closed.pop(event.arm))
                rest(plant, WAIT)
                figures['fell'] = max(figures['fell'], float(np.linalg.norm(plant.points(
                    np.linspace(0, 1, 41) * plant.length) - before, axis=1).max()))
        if motion is None:
            continue
        times = PERIOD * np.arange(1, int(motion.duration / PERIOD) + 2)
        ways = {name: motion.arm(name).poses(times) for name in motion.path.arms}
        for step in range(times.size):
            plant.move(FEED, PERIOD, hands={closed[name]: true(name, way[step])
                                            for name, way in ways.items()})
            least = min(least, HOLE.radius - CABLE.radius - plant.passage(HOLE).miss) if (
                plant.passage(HOLE).depth > 0) else least
    rest(plant, WAIT)
    return {**figures, 'touched': float(plant.largest_forces.max()), 'seconds': plant.time,
            'room': float(least), 'passed': plant.passage(HOLE).depth}


def rest(plant, seconds):
    for _ in range(int(seconds / PERIOD)):
        plant.move(FEED, PERIOD)


def is_done(figures):
    """Whether a run touched nothing and passed in full."""
    return (figures['touched'] < TOUCH and figures['passed'] > LENGTH - JAWS
            and figures['caught'] < JAWS)


def main(seeds=10, first=0, pulls=1, loose=0):
    plan, motions = planned(pulls, bool(loose))
    print(plan, [str(one) for one in plan.events], flush=True)
    done = 0
    for seed in range(first, first + seeds):
        try:
            figures = executed(plan, motions, seed)
        except NotConverged as error:
            print(seed, f'FAILED {error}', flush=True)
            continue
        done += is_done(figures)
        print(seed, 'done' if is_done(figures) else 'FAILED', ', '.join(
            f'{name} {value:.4g}' for name, value in figures.items()), flush=True)
    print(f'{done} of {seeds} done')


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
