# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One run of a driver in the plant, and its outcome."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.cell.camera import Camera, Viewer
from dlo_planner.cell.drivers import PERIOD, Command, Driver
from dlo_planner.cell.plant import Plant
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import NOTHING_UNKNOWN, Unknowns
from dlo_planner.errors import DeadlineExceeded, Infeasible, NotConverged
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value

TOUCH = 0.05      # N: a larger contact force counts as a touch
STEP = 2e-3       # s, of the plant
CELLS = 80        # of the plant
_FINER = 1.4      # times as many cells as the plant that runs once more
_LOOKED_AT = 5    # periods of control between two measurements of the miss
_SHORT = 0.005    # of the length, by which the depth may fall short
_LONGEST = 300.0  # s, of a run
_STOP = 5.0       # N: a larger contact force ends a run
_REFUSALS = Infeasible, NotConverged, DeadlineExceeded


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Value):
    """The outcome of a Task.

    Attributes
    ----------
    seed : int
        Seed of the Truth and of the camera's errors.
    refused : str
        Why the driver gave up, at the beginning or later; empty: it did not.
    threaded : bool
        Whether the DLO is through the hole to its depth at the end, its misses below the radius; a
        force of more than 5 N ends a run.
    depth : float
        Length of the DLO beyond the sheet at the end, m.
    miss : float
        Largest distance from the center of the hole, in its plane, of the DLO that crosses it,
        every 20 ms, m; nan if it never did. Without a camera, extrapolated to a DLO that is no
        chain, see `run`.
    force : float
        Largest contact force on the DLO, N.
    time : float
        Duration of the motion, s.
    promised : float
        The largest miss that the driver expected, m; nan if it does not say.
    chain_error : float
        By how much the extrapolation moved the DLO in the hole, m: the error of the plant's chain
        there; nan with a camera.
    """

    seed: int
    refused: str
    threaded: bool = False
    depth: float = 0.0
    miss: float = np.nan
    force: float = 0.0
    time: float = 0.0
    promised: float = np.nan
    chain_error: float = np.nan

    @property
    def touched(self) -> bool:
        """Whether the DLO touched anything with more than TOUCH."""
        return self.force > TOUCH


def run(task: Task, driver: Driver, *, seed: int = 0, unknowns: Unknowns = NOTHING_UNKNOWN,
        camera: Camera | None = None, damping: float = 0.005, step: float = STEP,
        watch: Callable[[Plant], object] | None = None) -> Outcome:
    """Return the Outcome of a Task.

    The plant is a chain, whose error is of second order in the length of its cells. Without a
    camera the same motion is run once more with a coarser chain, and the place where the DLO
    crosses the hole is extrapolated from both (Richardson) at each time. With a camera the driver
    reacts to the chain that it sees: there it is the DLO.

    The driver knows the damping, as the rod's: it is not among the Unknowns.

    Parameters
    ----------
    task : Task
    driver : Driver
        See `drivers`.
    seed : int, optional
        Seed of the Truth and of the camera's errors.
    unknowns : Unknowns, optional
        Unknowns from which one Truth is drawn.
    camera : Camera, optional
        Camera. If None, there is none.
    damping, step : float, optional
        Ratio and s, see `Plant`: a shorter step allows less damping.
    watch : callable, optional
        Called as watch(plant) after each period.

    Raises
    ------
    InvalidTask
        An argument makes no sense, or the driver gives one that makes none.
    """
    instance('task', task, Task)
    rng = np.random.default_rng([integer('seed', seed, minimum=0, maximum=2**31), 78])
    truth = instance('unknowns', unknowns, Unknowns).draw(rng)
    viewer = None if camera is None else Viewer(instance('camera', camera, Camera), rng)
    try:
        plant, coarser = (Plant(task.rod, task.start, [task.sheet], truth=truth, cells=cells,
                                step=step, damping=damping)
                          for cells in (CELLS, round(CELLS / _FINER)))
        command = driver(replace(task, rod=replace(task.rod, damping=(0.0, plant.lag))))
    except _REFUSALS as error:
        return Outcome(seed, _reason(error))
    driven = _drive(plant, command, task, viewer, watch)
    moved, refused = np.nan, driven.refused
    if viewer is None and not refused:
        again = _drive(coarser, _Again(driven.poses), task, None, None)
        driven, moved = _extrapolated(driven, again)
    passage, miss = plant.passage(task.cutout), driven.miss
    threaded = (passage.depth > task.depth - _SHORT * task.rod.length
                and miss < task.radius and not refused)
    return Outcome(seed, refused, bool(threaded), passage.depth, miss,
                   float(plant.largest_forces[0]), plant.time,
                   float(getattr(command, 'promised', np.nan)), moved)


@dataclass(frozen=True)
class _Driven:
    """What happened: the poses of all periods, and where the hole was crossed.

    Attributes
    ----------
    poses : list of Pose
    crossings : dict
        Period -> (2,) coordinates in the plane of the hole, m.
    refused : str
        Why the driver gave up.
    """

    poses: list[Pose]
    crossings: dict[int, Floats]
    refused: str = ''

    @property
    def miss(self) -> float:
        """The largest distance from the center, m; nan if the hole was not crossed."""
        return float(max(map(np.linalg.norm, self.crossings.values()), default=np.nan))


class _Again:
    """The command that gives known poses."""

    def __init__(self, poses: list[Pose]) -> None:
        self._poses = iter(poses)

    def __call__(self, images: object, time: float) -> Pose | None:
        return next(self._poses, None)


def _extrapolated(fine: _Driven, coarse: _Driven) -> tuple[_Driven, float]:
    """Return what would happen with endless cells, and how far that is from `fine` at most, m."""
    both = sorted(fine.crossings.keys() & coarse.crossings.keys())
    moved = {k: (fine.crossings[k] - coarse.crossings[k]) / (_FINER**2 - 1) for k in both}
    crossings = {k: at + moved.get(k, 0.0) for k, at in fine.crossings.items()}
    if fine.crossings and not both:
        return fine, np.nan
    return (_Driven(fine.poses, crossings, fine.refused),
            float(max(map(np.linalg.norm, moved.values()), default=np.nan)))


def _drive(plant: Plant, command: Command, task: Task, viewer: Viewer | None,
           watch: Callable[[Plant], object] | None) -> _Driven:
    """Move the gripper until the command is done, or gives up."""
    poses: list[Pose] = []
    crossings: dict[int, Floats] = {}
    for count in range(int(_LONGEST / PERIOD)):
        images = () if viewer is None else viewer.images(plant, task.cutout)
        try:
            pose = command(images, plant.time)
            if pose is None:
                break
            poses.append(pose)
            plant.move(pose, PERIOD)
        except _REFUSALS as error:
            return _Driven(poses, crossings, _reason(error))
        if watch is not None:
            watch(plant)
        if plant.largest_forces.max() > _STOP:
            break
        if count % _LOOKED_AT == 0:
            passage = plant.passage(task.cutout)
            if passage.depth > 0:
                crossings[count] = np.array([passage.y, passage.z])
    return _Driven(poses, crossings)


def _reason(error: Exception) -> str:
    return f'{type(error).__name__}: {error}'
