# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks for the cell: a DLO, a hole, and a pose to begin with."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import choice, instance, integer, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, put

RODS = {  # those of config/, the wire in two diameters
    'wire 1.5': Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34),
    'wire 2': Rod.circular(1.0, 2e-3, 8960.0, 110e9, 0.34),
    'hose': Rod.tube(0.5, 0.016, 0.010, 1150.0, 8e6, 0.49, natural_curvature=(0.0, 0.5)),
    'leaf spring': Rod.rectangular(0.8, 0.020, 0.0005, 7850.0, 206e9, 0.29)}
RADII = 0.004, 0.02  # of holes, m
_LEAST_ROOM = 0.0025  # m: a hole for a thick DLO is wider
_SIDE, _THICKNESS = 0.4, 1e-3  # m, of the sheet
_DEPTH = 0.7         # of the length: of a threading
_STEEPEST = np.radians(60)  # of the way through the hole: a soft DLO cannot go straight up
_CENTER = np.array([0.0, 0.0, 1.0])  # m, of the hole


@dataclass(frozen=True, eq=False, repr=False)
class Task(Value):
    """A DLO to be threaded through a hole."""

    name: str  # name of the DLO
    rod: Rod  # rod, as the planner knows it
    cutout: CutOut  # cutOut with a radius
    start: Pose  # pose of the gripper at the beginning, in which the DLO hangs at rest
    depth: float  # length of the DLO that has to go through, m

    def __post_init__(self) -> None:
        instance('Task.name', self.name, str)
        instance('Task.rod', self.rod, Rod)
        instance('Task.cutout', self.cutout, CutOut)
        instance('Task.start', self.start, Pose)
        if self.cutout.radius is None or self.rod.radius is None or callable(self.rod.radius):
            raise InvalidTask(f'Task.cutout = {self.cutout!r}, Task.rod = {self.rod!r}: expected '
                              'both with a radius')
        if self.room <= 0:
            raise InvalidTask(f'Task.cutout.radius = {self.cutout.radius:g}: expected more than '
                              f"the DLO's {self.rod.radius:g} m")
        put(self, depth=number('Task.depth', self.depth, above=0, maximum=self.rod.length))
        super().__post_init__()

    @property
    def sheet(self) -> Sheet:
        """The Sheet around the hole."""
        return Sheet.around(self.cutout, _SIDE, _SIDE, _THICKNESS)

    @property
    def cutouts(self) -> tuple[CutOut, ...]:
        """The cut-outs, in their order."""
        return (self.cutout,)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What the planner knows of."""
        return (self.sheet,)

    @property
    def bodies(self) -> tuple[Obstacle, ...]:
        """What there is."""
        return self.obstacles

    @property
    def radius(self) -> float:
        """Of the hole, m."""
        assert self.cutout.radius is not None  # judged when it is made
        return self.cutout.radius

    @property
    def room(self) -> float:
        """The largest miss with which the DLO does not touch the rim, m."""
        return self.radius - even_radius(self.rod)


def draw_task(seed: int, name: str | None = None, radius: float | None = None) -> Task:
    """Return the Task of a seed, always the same."""
    rng = np.random.default_rng([integer('seed', seed, minimum=0, maximum=2**31), 77])
    name = list(RODS)[seed % len(RODS)] if name is None else choice('name', name, list(RODS))
    rod = RODS[name]
    smallest = max(RADII[0], even_radius(rod) + _LEAST_ROOM)
    drawn = rng.uniform(smallest, RADII[1])
    height = rng.uniform(-1, 1) * np.sin(_STEEPEST)
    angle, level = rng.uniform(-np.pi, np.pi), np.sqrt(1 - height**2)
    hole = CutOut(Pose.looking_along(
        _CENTER, (level * np.cos(angle), level * np.sin(angle), height)),
                  radius=drawn if radius is None else radius)
    back, aside = rng.uniform(1.05, 1.4), rng.uniform(-0.3, 0.3, 2)
    position = hole.pose.position + rod.length * hole.pose.rotation @ (-back, *aside)
    tilt = hole.normal + rng.uniform(-0.4, 0.4, 3)
    return Task(name, rod, hole, Pose.looking_along(position, tilt), _DEPTH * rod.length)


def even_radius(rod: Rod) -> float:
    """Return the radius of a Rod that is as thick all along, m; raise InvalidTask."""
    if not isinstance(rod.radius, float):
        raise InvalidTask(f'rod.radius = {rod.radius!r}: expected a number')
    return rod.radius
