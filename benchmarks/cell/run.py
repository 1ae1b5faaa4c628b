# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One run of a driver in the plant, and its outcome."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import repeat
from math import ceil
from typing import NamedTuple

import numpy as np

from benchmarks.cell.drivers import PERIOD, Command, Driver
from benchmarks.cell.other_tasks import OtherTask
from dlo_planner import Insert
from dlo_planner.cell.camera import Camera, Image, Viewer
from dlo_planner.cell.disturbances import UNDISTURBED, Disturbances
from dlo_planner.cell.plant import STEP, TOUCH, Plant
from dlo_planner.cell.robot import Robot
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import NOTHING_UNKNOWN, Unknowns
from dlo_planner.errors import DeadlineExceeded, Infeasible, NotConverged
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, number
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value

RAM = 1.0         # N: a larger contact force counts as a ram
CELLS = 80        # of a plant that is not looked at
SEEN_CELLS = 30   # of one that is: within 0.3 mm of 1 m of 80, its frequencies within 0.2 %
_FINER = 1.4      # times as many cells as the plant that runs once more
_LOOKED_AT = 2    # periods of control between two measurements of the miss
_SHORT = 5e-3     # m, by which the depth may fall short: lengths are known to 1 mm
_LONGEST = 300.0  # s, of a run
_STOP = 5.0       # N: a larger contact force ends a run
_ROUNDING = 1e-9  # of a number of periods
_REFUSALS = Infeasible, NotConverged, DeadlineExceeded


class Stay(NamedTuple):
    """A time in which the DLO was in the hole: one, unless the driver turned back in it."""

    begin: float  # seconds since the beginning of the run
    end: float
    # largest distance of the DLO from the center of the hole in it, m: across the DLO, as what is
    # promised, where it pierces the hole obliquely
    miss: float
    # the largest miss that the driver expected when it began, m; nan if it did not say
    promised: float


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Value):
    """The outcome of a Task."""

    seed: int  # seed of the Truth and of the camera's errors
    refused: str  # why the driver gave up, at the beginning or later; empty: it did not
    # whether the DLO is through the hole to its depth at the end, its misses below the radius; a
    # force of more than 5 N ends a run
    threaded: bool = False
    depth: float = 0.0  # length of the DLO beyond the sheet at the end, m
    # largest distance from the center of the hole, in its plane, of the DLO that crosses it, every
    # 20 ms, m; nan if it never did. Without a camera, extrapolated to a DLO that is no chain, see
    # `run`
    miss: float = np.nan
    force: float = 0.0  # largest contact force on the DLO, N; inf if the simulation became unstable
    # the same of the times in which the DLO was not in the hole: what it pushes a sheet with
    pushed: float = 0.0
    time: float = 0.0  # duration of the motion, s
    # the largest miss that the driver expected when the DLO first came into the plane of the hole,
    # or at the end if it never did, m; nan if it did not say
    promised: float = np.nan
    phase: str = ''  # what the driver was at in the end; empty if it does not say
    stays: tuple[Stay, ...] = ()  # the times in the hole

    @property
    def touched(self) -> bool:
        """Whether the DLO touched anything with more than TOUCH."""
        return self.force > TOUCH

    @property
    def pushes(self) -> bool:
        """Whether it touched anything with more than TOUCH while it was not in the hole."""
        return self.pushed > TOUCH

    @property
    def rammed(self) -> bool:
        """Whether the DLO touched anything with more than RAM."""
        return self.force > RAM

    @property
    def clean(self) -> bool:
        """Whether the DLO was threaded without a touch."""
        return self.threaded and not self.touched


def run(task: Task, driver: Driver, *, seed: int = 0, unknowns: Unknowns = NOTHING_UNKNOWN,
        disturbances: Disturbances = UNDISTURBED, camera: Camera | None = None,
        damping: float = 0.005, step: float = STEP, cells: int | None = None,
        watch: Callable[[Plant], object] | None = None) -> Outcome:
    """Return the Outcome of a Task.

    The plant is a chain, whose error is of second order in the length of its cells. Without a
    camera the same motion is run once more with a coarser chain, and the place where the DLO
    crosses the hole is extrapolated from both (Richardson) at each time. With a camera the driver
    reacts to the chain that it sees: there it is the DLO.

    The driver gets what a robot has: the DLO, sheet and damping as stated (the latter as
    `Rod.damping`), the images, and the poses that the robot measures. `cells` is the number of the
    chain; None: CELLS without a camera, SEEN_CELLS with one.
    """
    instance('task', task, Task)
    rng = np.random.default_rng([integer('seed', seed, minimum=0, maximum=2**31), 78])
    truth = instance('unknowns', unknowns, Unknowns).draw(rng)
    instance('disturbances', disturbances, Disturbances)
    truth = replace(truth, hole_shift=truth.hole_shift + disturbances.sheets_shift)
    viewer = None if camera is None else Viewer(instance('camera', camera, Camera), rng)
    course = disturbances.draw(np.random.default_rng([seed, 79]))
    bodies = [replace(one, friction=disturbances.friction) for one in task.bodies]

    def hung(cells: int) -> Plant:
        return Plant(task.rod, task.start, bodies, truth=truth, cells=cells, step=step,
                     damping=number('damping', damping, minimum=0) * truth.damping, course=course)

    try:
        plant = hung(cells or (CELLS if viewer is None else SEEN_CELLS))
        stated = (0.0, plant.lag / truth.damping)
        command = driver(replace(task, rod=replace(task.rod, damping=stated)))
    except _REFUSALS as error:
        return Outcome(seed, _reason(error))
    driven = _drive(plant, command, task, viewer, watch, disturbances.lag)
    if viewer is None and not driven.refused:
        coarse = hung(round((cells or CELLS) / _FINER))
        driven = _extrapolated(driven, _drive(coarse, _Again(driven.poses), task, None, None, 0.0))
    depth, miss = plant.passage(task.cutout).depth, driven.miss
    threaded = (depth > task.depth - _SHORT
                and miss < task.radius and not driven.refused)
    if isinstance(task, OtherTask) and not task.cutouts:  # a contact
        miss, depth = task.off(plant.points([task.rod.length - task.depth])), task.depth
        threaded = bool(plant.forces.any()) and miss < task.radius and not driven.refused
    return Outcome(seed, driven.refused, bool(threaded), depth, miss, driven.force,
                   driven.pushed, plant.time, driven.promised, str(getattr(command, 'phase', '')),
                   tuple(driven.stays))


@dataclass
class _Driven:
    """What happened: the poses of all periods, and where the hole was crossed."""

    poses: list[Pose] = field(default_factory=list)  # measured ones
    # period -> (2,) coordinates in the plane of the hole, m
    crossings: dict[int, Floats] = field(default_factory=dict)
    leans: dict[int, float] = field(default_factory=dict)  # distances across the DLO over those
    force: float = 0.0  # largest contact force, N
    pushed: float = 0.0  # the same while it was not in the hole, N
    # first period of a stay in the hole -> what was promised last before it, m
    promises: dict[int, float] = field(default_factory=dict)
    expected: float = np.nan  # what was promised last outside the hole, m
    refused: str = ''  # why the driver gave up

    @property
    def miss(self) -> float:
        """The largest distance from the center, m; nan if the hole was not crossed."""
        return float(max(map(np.linalg.norm, self.crossings.values()), default=np.nan))

    @property
    def promised(self) -> float:
        """What was promised of the first stay, or last if there was none, m."""
        return next(iter(self.promises.values()), self.expected)

    @property
    def stays(self) -> list[Stay]:
        """The times in the hole."""
        begins = [*self.promises, np.inf]
        return [Stay(PERIOD * begin, PERIOD * max(within), float(max(
            np.linalg.norm(self.crossings[k]) * self.leans[k] for k in within)), promised)
            for (begin, promised), after in zip(self.promises.items(), begins[1:], strict=True)
            if (within := [k for k in self.crossings if begin <= k < after])]


class _Again:
    """The command that gives known poses."""

    def __init__(self, poses: list[Pose]) -> None:
        self._poses = iter(poses)

    def __call__(self, images: object, time: float, gripper: object) -> Pose | None:
        return next(self._poses, None)


def _extrapolated(fine: _Driven, coarse: _Driven) -> _Driven:
    """Return what would happen with endless cells."""
    both = fine.crossings.keys() & coarse.crossings.keys()
    return replace(fine, crossings={
        k: at + (at - coarse.crossings[k]) / (_FINER**2 - 1) if k in both else at
        for k, at in fine.crossings.items()})


def _drive(plant: Plant, command: Command, task: Task, viewer: Viewer | None,
           watch: Callable[[Plant], object] | None, lag: float) -> _Driven:
    """Move the gripper until the command is done, or gives up."""
    driven, arrived, robot = _Driven(), list[Image](), Robot(task.start, lag)
    told, inside = _told(command, arrived, plant, robot), False
    # its wall leads the DLO, once it is inside
    in_bore = isinstance(task, OtherTask) and isinstance(task.goal, Insert)
    for count in range(int(_LONGEST / PERIOD)):
        if viewer is not None:
            arrived.extend(viewer.images(plant, task.cutout))
        try:
            pose = next(told, None)
        except _REFUSALS as error:
            driven.refused = _reason(error)
            break
        if pose is None:
            break
        ahead = getattr(command, 'ahead', None)
        if ahead is not None:
            robot.follow_ahead(*ahead)
        robot.follow(pose)
        driven.poses.append(robot.moved(plant.time, PERIOD))
        try:
            plant.move(robot.pose, PERIOD)
        except NotConverged:
            driven.force = driven.pushed = np.inf
            break
        driven.force = float(plant.largest_forces.max())
        if not inside:
            driven.pushed = max(driven.pushed, float(plant.forces.max()))
        if watch is not None:
            watch(plant)
        if driven.force > _STOP:
            break
        if count % _LOOKED_AT == 0:
            passed = [one for one in map(plant.passage, task.cutouts) if one.depth > 0]
            if passed and not (inside and in_bore):
                worst = max(passed, key=lambda one: one.miss)
                driven.crossings[count] = np.array([worst.y, worst.z])
                driven.leans[count] = worst.off / worst.miss if worst.miss else 1.0
                if not inside:
                    driven.promises[count] = driven.expected
            inside = bool(passed)
        if not inside:
            driven.expected = float(getattr(command, 'promised', np.nan))
    return driven


def _told(command: Command, arrived: list[Image], plant: Plant, robot: Robot) -> Iterator[Pose]:
    """Yield for each period what the robot is told; while the command is busy, the last once more.

    Images that have `arrived` are taken away when the command gets them.
    """
    last = robot.pose
    while True:
        images = tuple(arrived)
        arrived.clear()
        pose = command(images, plant.time, robot.pose)
        busy = number('busy', getattr(command, 'busy', 0.0), minimum=0, maximum=_LONGEST)
        yield from repeat(last, ceil(busy / PERIOD * (1 - _ROUNDING)))
        if pose is None:
            return
        yield pose
        last = pose


def _reason(error: Exception) -> str:
    return f'{type(error).__name__}: {error}'
