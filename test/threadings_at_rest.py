# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whole threadings in a closed loop, in exact time, with the direct simulator as the truth.

The DLO is always at rest in the true pose of the gripper, or bent by inertia nearly as the driver
expects it, so it costs seconds and not minutes; what inertia does is seen in the cell. The driver
is the one of the node and of the cell.

`python test/threadings_at_rest.py [kind] [begin:end]` prints what came of each.
"""

import sys
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

from closed_loops import SPREAD, WIRE, Truth  # noqa: E402

from dlo_planner import (  # noqa: E402
    DirectSimulator,
    DloPlannerError,
    InvalidTask,
    InverseSimulator,
    Pose,
    Sheet,
)
from dlo_planner.cell.disturbances import Disturbances  # noqa: E402
from dlo_planner.cell.tasks import draw_task  # noqa: E402
from dlo_planner.execute.guards import Heard  # noqa: E402
from dlo_planner.execute.threading_loop import ThreadingLoop  # noqa: E402
from dlo_planner.execute.threading_motions import Threading  # noqa: E402
from dlo_planner.identify.closed_loop import Phase  # noqa: E402
from dlo_planner.identify.observing import Observing, Seeing  # noqa: E402

PERIOD, PLANNING, LATE = 0.02, 2.0, 0.1  # s: of control, of a plan, from an image to its look
RADIUS = 5e-3  # m, of the hole
STATED = {'robot_position': 0.35e-3, 'robot_rotation': 1e-3}
LONGEST = 150.0  # s
PUSHED = 0.03    # m by which the free end goes on beside the hole: a wire is soft until then


@dataclass(frozen=True)
class World:
    """What happens to a threading.

    Attributes
    ----------
    robot, wander : (float, float)
        Deviations of the robot's error by its pose, and of one that wanders in time, m, rad, along
        and about each axis.
    slip : (float, float)
        By which the DLO slips back, m, and turns about an axis across it, rad.
    bump : float
        By how much something moves the free end, m; it swings on, damped.
    at : float
        When that happens, s.
    blind : bool
        Whether the free third is hidden half of the time.
    """

    robot: tuple[float, float] = (0.35e-3, 1e-3)
    wander: tuple[float, float] = (0.0, 0.0)
    slip: tuple[float, float] = (0.0, 0.0)
    bump: float = 0.0
    at: float = 15.0
    blind: bool = False


KINDS = {'nominal': World(), 'slip': World(slip=(2e-3, np.radians(1))),
         'small slip': World(slip=(0.5e-3, np.radians(0.29))), 'bump': World(bump=0.01),
         'wander': World(robot=(0.0, 0.0), wander=(0.7e-3, 2.5e-3)), 'blind': World(blind=True)}


@dataclass
class Came:
    """What came of a threading; lengths in m.

    Attributes
    ----------
    end : Phase
    tries : int
    miss : float
        The largest at which the DLO crossed the hole; nan if it did not.
    promised : float
        What was promised when it came in.
    rammed : bool
        Whether the free end was pushed against the sheet beside the hole.
    depth, time, work : float
        How deep it was at the end, m; the duration, s; seconds of computing.
    log : list of str
    """

    end: Phase = Phase.STOP
    tries: int = 0
    miss: float = np.nan
    promised: float = np.nan
    rammed: bool = False
    depth: float = 0.0
    time: float = 0.0
    work: float = 0.0
    reason: str = ''
    log: list[str] = field(default_factory=list)

    @property
    def clean(self):
        """Whether it is through without a touch."""
        return self.end is Phase.DONE and self.miss < RADIUS - WIRE.radius


class Plant:
    """A DLO at rest in the true pose of a robot that errs."""

    def __init__(self, world, rng, hole):
        self.world, self.rng, self.hole = world, rng, hole
        self.truth = Truth.drawn(rng, bias=0.5e-3, cutout=0.5e-3)
        self._course = Disturbances(*world.robot, *world.wander).draw(rng)
        self._axis, self._side = rng.normal(size=3) * (0, 1, 1), rng.normal(size=3)
        self._hidden = rng.uniform(0.05, 0.3)  # where a third is hidden, from the gripper on

    def shape(self, time, measured):
        """Return the Shape at a time, s, for a measured pose."""
        world = self.world
        shift, turn = self._course.robot_error(measured.position, measured.rotation, time)
        true = self.truth.offset.compose(Pose(shift, Rotation.from_rotvec(turn).as_quat()))
        if time > world.at and any(world.slip):
            turn = world.slip[1] * self._axis / np.linalg.norm(self._axis)
            true = true.compose(Pose((-world.slip[0], 0, 0), Rotation.from_rotvec(turn).as_quat()))
        return self.truth.simulator.solve(measured.compose(true))

    def swing(self, time):
        """Return by how much (3,) the free end is off its rest, m."""
        since = time - self.world.at
        if since < 0 or not self.world.bump:
            return np.zeros(3)
        wave = np.sin(2 * np.pi * 0.9 * since) * np.exp(-0.03 * since)
        return self.world.bump * wave * self._side / np.linalg.norm(self._side)

    def points(self, time, measured, bent, count=20, outliers=0.1):
        """Return points (n, 3) of an image: a third is hidden, sometimes the free one."""
        shape, rng = self.shape(time, measured), self.rng
        s = rng.uniform(0, 2 / 3, count)
        if self.world.blind and np.sin(2 * np.pi * time / 6) > 0:
            pass  # the free third is hidden
        else:
            s = np.where(s > self._hidden, s + 1 / 3, s)
        points = shape.positions_at(s * shape.s[-1]) + 1e-3 * rng.normal(size=(count, 3))
        points += self.truth.bias + (s**2)[:, None] * self.swing(time)
        if bent is not None:
            even = np.linspace(0, 1, len(bent))
            points += 0.85 * np.stack([np.interp(s, even, part) for part in bent.T], axis=1)
        wild = rng.uniform(size=count) < outliers
        points[wild] += rng.uniform(-0.1, 0.1, (wild.sum(), 3))
        return points

    def crossing(self, time, measured):
        """Return the depth of the free end behind the true hole, m, and the miss there or nan."""
        shape = self.shape(time, measured)
        nodes = np.linspace(0, shape.s[-1], 400)
        places = shape.positions_at(nodes) - self.hole.center - self.truth.hole
        places += ((nodes / nodes[-1])**2)[:, None] * self.swing(time)
        ahead = places @ self.hole.normal
        if ahead[-1] < 0:
            return 0.0, np.nan
        k = int(np.flatnonzero(ahead < 0)[-1])
        share = ahead[k] / (ahead[k] - ahead[k + 1])
        there = (1 - share) * places[k] + share * places[k + 1]
        return nodes[-1] - nodes[k], float(np.linalg.norm(there))


def threaded(seed, world=World(), seeing=None, deepest=0.4, watch=None):  # noqa: B008 - frozen
    """Return what Came of one threading."""
    rng = np.random.default_rng([seed, 11])
    world = replace(world, at=rng.uniform(6, 22))
    task = draw_task(seed, 'wire 1.5', RADIUS)
    hole, plant = task.cutout, Plant(world, rng, task.cutout)
    seeing = seeing or Seeing(SPREAD, 1e-3, 0.5e-3, 0.1, cutout=0.5e-3, stamps=0.02, period=0.1,
                              **STATED)
    simulator = DirectSimulator(WIRE, obstacles=[Sheet.around(hole, 0.4, 0.4, 1e-3)])
    observing = Observing(simulator, seeing)
    loop = ThreadingLoop(Threading(InverseSimulator(simulator), hole,
                                   np.linspace(0, deepest, 25), 0.05), observing, task.start,
                         period=PERIOD)
    came, here, began, time, waits = Came(), task.start, process_time(), 0.0, 0.0
    images, work, result, phase, beside = [], None, None, None, False
    while time < LONGEST:
        observing.gripper(time, here)
        loop.gripper(Heard(here, time, 0.0, observing.off, time))
        if round(time / PERIOD) % 5 == 0:
            bent = observing.bent(time, here)
            images.append((time + LATE, time, plant.points(time, here, bent and bent[0])))
        while images and images[0][0] <= time:
            _, stamp, points = images.pop(0)
            if observing.due(stamp):
                observing.hole(hole.center, hole.center + plant.truth.hole + plant.truth.bias
                               + 1e-3 * rng.normal(size=3))
                with suppress(InvalidTask):
                    observing.look(stamp, points)
                if watch:
                    watch(time, loop)
        if loop.work is not None and waits == 0:
            work = loop.work
            try:
                result = work()
            except DloPlannerError as error:
                result = error
            waits = time + (PLANNING if loop.waits else LATE)
        if waits and time >= waits:
            loop.finish(work, result)
            waits = 0.0
        pose = loop.tick(time)
        if loop.phase is not phase:
            phase = loop.phase
            came.log.append(f'{time:.1f} {phase.value}')
        if pose is None:
            break
        here = pose
        if loop.phase in (Phase.ENTER, Phase.RETREAT) and round(time / PERIOD) % 5 == 0:
            depth, miss = plant.crossing(time, here)
            if depth > 0:
                if came.depth == 0:
                    came.promised, beside = loop.promised, miss > RADIUS
                    came.log.append(f'{time:.1f} {"beside it" if beside else "in"}')
                came.rammed = beside and depth > PUSHED
                came.miss = np.nanmax([came.miss, miss])
            came.depth = depth
            if came.rammed:
                break
        time += PERIOD
    if world != World():
        came.log.append(f'it happened at {world.at:.1f}')
    came.end, came.tries, came.reason, came.time = loop.phase, loop.tries, loop.reason, time
    came.work = process_time() - began
    return came


def main(kind, seeds):
    """Print what came of each, and how many."""
    found = []
    for seed in range(*seeds):
        came = threaded(seed, KINDS[kind])
        found.append(came)
        print(kind, seed, 'RAMMED' if came.rammed else 'clean' if came.clean else came.end.value,
              f'{came.tries} tries, miss {1e3 * came.miss:.2f} of {1e3 * came.promised:.2f} mm, '
              f'{came.time:.1f} s, {came.work:.1f} s of computing;', ', '.join(came.log),
              came.reason[:150], flush=True)
    inside = [came for came in found if np.isfinite(came.miss)]
    print(f'{kind}: {len(found)} threadings, {sum(came.clean for came in found)} clean, '
          f'{sum(came.rammed for came in found)} rammed, '
          f'{sum(came.end is Phase.STOP for came in found)} stopped, covered '
          f'{sum(came.miss <= came.promised for came in inside)} of {len(inside)}')


if __name__ == '__main__':
    main(sys.argv[1] if len(sys.argv) > 1 else 'nominal',
         [int(one) for one in (sys.argv[2] if len(sys.argv) > 2 else '0:5').split(':')])
