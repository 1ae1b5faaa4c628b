# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One run of a driver in the plant, and its outcome."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.cell.camera import Camera, Viewer
from dlo_planner.cell.drivers import PERIOD, Command, Driver
from dlo_planner.cell.plant import Plant
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import NOTHING_UNKNOWN, Unknowns
from dlo_planner.errors import DeadlineExceeded, Infeasible, NotConverged
from dlo_planner.model.checks import instance, integer
from dlo_planner.model.value import Value

TOUCH = 0.05      # N: a larger contact force counts as a touch
STEP = 2e-3       # s, of the plant
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
        every 20 ms, m; nan if it never did.
    force : float
        Largest contact force on the DLO, N.
    time : float
        Duration of the motion, s.
    promised : float
        The largest miss that the driver expected, m; nan if it does not say.
    """

    seed: int
    refused: str
    threaded: bool = False
    depth: float = 0.0
    miss: float = np.nan
    force: float = 0.0
    time: float = 0.0
    promised: float = np.nan

    @property
    def touched(self) -> bool:
        """Whether the DLO touched anything with more than TOUCH."""
        return self.force > TOUCH


def run(task: Task, driver: Driver, *, seed: int = 0, unknowns: Unknowns = NOTHING_UNKNOWN,
        camera: Camera | None = None, damping: float = 0.005, step: float = STEP,
        watch: Callable[[Plant], object] | None = None) -> Outcome:
    """Return the Outcome of a Task.

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
        command = driver(task)
        plant = Plant(task.rod, task.start, [task.sheet], truth=truth, step=step, damping=damping)
    except _REFUSALS as error:
        return Outcome(seed, _reason(error))
    misses, refused = _drive(plant, command, task, viewer, watch)
    passage, miss = plant.passage(task.cutout), max(misses, default=np.nan)
    threaded = (passage.depth > task.depth - _SHORT * task.rod.length
                and miss < task.radius and not refused)
    return Outcome(seed, refused, bool(threaded), passage.depth, float(miss),
                   float(plant.largest_forces[0]), plant.time,
                   float(getattr(command, 'promised', np.nan)))


def _drive(plant: Plant, command: Command, task: Task, viewer: Viewer | None,
           watch: Callable[[Plant], object] | None) -> tuple[list[float], str]:
    """Move the gripper until the command is done; return the misses, and why it gave up."""
    misses: list[float] = []
    for count in range(int(_LONGEST / PERIOD)):
        images = () if viewer is None else viewer.images(plant, task.cutout)
        try:
            pose = command(images, plant.time)
            if pose is None:
                break
            plant.move(pose, PERIOD)
        except _REFUSALS as error:
            return misses, _reason(error)
        if watch is not None:
            watch(plant)
        if plant.largest_forces.max() > _STOP:
            break
        if count % _LOOKED_AT == 0:
            passage = plant.passage(task.cutout)
            if passage.depth > 0:
                misses.append(passage.miss)
    return misses, ''


def _reason(error: Exception) -> str:
    return f'{type(error).__name__}: {error}'
