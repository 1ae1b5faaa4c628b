# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks for the cell beside one cut-out on the normal.

Two and three cut-outs, a bore, a contact that is held, and one cut-out that a soft wire passes
obliquely.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    HoldContact,
    Infeasible,
    Insert,
    InverseSimulator,
    NotConverged,
    Pose,
    Rod,
    Sheet,
    Thread,
    ThreadSequence,
    ThreadTwo,
)
from dlo_planner import tasks as inverse
from dlo_planner.cell.tasks import RODS, Task, draw_task, even_radius
from dlo_planner.inverse.tasks.thread_sequence import cutouts_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance
from dlo_planner.model.obstacles import Obstacle

KINDS = 'two', 'three', 'insert', 'hold', 'oblique'
WAYPOINTS = 40   # of a threading
# As the measured wire of docs/validation.md, 0.2 m with w L^3/EI = 11 and holes of 10 mm: m, of
# the length; w L^3/EI, even in its logarithm; m, of the radius of the hole; degrees, by which the
# way through it rises. Steeper ones have hardly any plan
_SOFT_LENGTHS, _SOFTNESS, _SOFT_RADII, _RISES = (0.2, 0.4), (8.0, 40.0), (8e-3, 12e-3), (-30, 10)
_SOFT_RADIUS, _SOFT_MASS = 1.5e-3, 0.0158  # m; kg/m, of a copper wire of 1.5 mm in a sheath
_SHEAR = 1.34        # EI by GJ of a round section of copper
_OBLIQUE = 0.05      # rad from the normal, at least
_SOFT_DEPTH = 0.7    # of the length: of the threading
# of the length: of the cut-outs. Three that are farther apart leave no free room: a DLO passes two
# centers exactly, and the third by 4 mm at 15 cm, by 1 mm at 10 cm
_PLACES = {'two': (0.35, 0.6), 'three': (0.55, 0.65, 0.75)}
_ASIDE = 5e-3             # m: by which two lie beside a shape in which the DLO hangs
_SHEET, _THICKNESS = 0.2, 1e-3  # m
_INSERTED, _BORE = 0.12, 0.15  # m: how deep, and the length of the bore
_FLATTEST = 0.5           # of the height of a direction: a bore is not as steep as a hole
_BAR = 0.02, 0.3          # m, radius and half length


@dataclass(frozen=True, eq=False, repr=False)
class OtherTask(Task):
    """A task whose first place is `cutout`; of a contact its radius is what it may be missed by."""

    goal: inverse.Task
    bar: Capsule | None = None  # that is touched

    def __post_init__(self) -> None:
        instance('OtherTask.goal', self.goal, inverse.Task)
        super().__post_init__()

    @property
    def cutouts(self) -> tuple[CutOut, ...]:
        """The cut-outs, in their order."""
        return cutouts_of(self.goal)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What the planner knows of."""
        return (self.bar,) if self.bar else tuple(
            Sheet.around(one, _SHEET, _SHEET, _THICKNESS) for one in self.cutouts)

    @property
    def bodies(self) -> tuple[Obstacle, ...]:
        """What there is: a bore is longer than its mouth."""
        if not isinstance(self.goal, Insert):
            return self.obstacles
        mouth = self.cutout
        middle = Pose(mouth.center + 0.5 * _BORE * mouth.normal, mouth.pose.quaternion)
        return (Sheet.around(replace(mouth, pose=middle), _SHEET, _SHEET, _BORE),)

    def off(self, points: Floats) -> float:
        """Return how far the point (1, 3) that should touch is from its place, m."""
        contact = self.cutout.pose
        place = contact.position + even_radius(self.rod) * contact.rotation[:, 2]
        return float(np.linalg.norm(points[0] - place))


def draw_other(kind: str, seed: int, name: str, radius: float) -> Task:
    """Return the task of a kind and a seed, always the same.

    DLO and radius of 'oblique' are drawn as well.
    """
    choice('kind', kind, KINDS)
    if kind == 'oblique':
        return draw_oblique(seed)
    rng = np.random.default_rng([seed, 81])
    rod = RODS[name]
    if kind == 'insert':
        drawn = draw_task(seed, name, radius)
        x, y, z = drawn.cutout.normal
        bore = CutOut(Pose.looking_along(drawn.cutout.center, (x, y, _FLATTEST * z)), radius=radius)
        return OtherTask(name, rod, bore, drawn.start, _INSERTED, Insert(
            bore, np.linspace(0, _INSERTED, WAYPOINTS // 4)))
    if kind == 'hold':
        return _held(rng, name, rod, radius)
    pose = Pose.looking_along((0, 0, 0), (1, 0, rng.uniform(0.0, 0.5)))
    hanging, rolled = DirectSimulator(rod).solve(pose), rng.uniform(-np.pi, np.pi)
    turn, places = Rotation.from_euler('z', rolled), np.array(_PLACES[kind]) * rod.length
    frames = [hanging.frame_at(float(s)) for s in places]
    first = frames[0][1]
    aside = _ASIDE * (kind == 'two')
    holes = [CutOut(Pose.looking_along(
        np.array([0, 0, 1.0]) + turn.apply(place - first) + rng.uniform(-aside, aside, 3),
        turn.apply(axes[:, 0])), radius=radius) for axes, place in frames]
    depths = np.linspace(0, rod.length - places[0], WAYPOINTS)
    goal = ThreadTwo(*holes, depths) if kind == 'two' else ThreadSequence(holes, None, depths)
    back, beside = rng.uniform(1.05, 1.4), rng.uniform(-0.2, 0.2, 2)
    begin = holes[0].center + rod.length * holes[0].pose.rotation @ (-back, *beside)
    start = Pose.looking_along(begin, holes[0].normal + rng.uniform(-0.3, 0.3, 3))
    return OtherTask(name, rod, holes[0], start, float(depths[-1]), goal)


def draw_oblique(seed: int) -> Task:
    """Return the task of a seed: a soft wire and a hole that it passes obliquely as planned."""
    rng = np.random.default_rng([seed, 82])
    while True:
        length, softness = rng.uniform(*_SOFT_LENGTHS), np.exp(rng.uniform(*np.log(_SOFTNESS)))
        radius, rise = rng.uniform(*_SOFT_RADII), np.radians(rng.uniform(*_RISES))
        angle, level = rng.uniform(-np.pi, np.pi), np.cos(rise)
        stiffness = _SOFT_MASS * 9.81 * length**3 / softness
        rod = Rod(length, _SOFT_MASS, stiffness, stiffness / _SHEAR, radius=_SOFT_RADIUS)
        hole = CutOut(Pose.looking_along((0, 0, 1), (
            level * np.cos(angle), level * np.sin(angle), np.sin(rise))), radius=radius)
        back, aside = rng.uniform(1.05, 1.4), rng.uniform(-0.3, 0.3, 2)
        begin = hole.center + length * hole.pose.rotation @ (-back, *aside)
        start = Pose.looking_along(begin, hole.normal + rng.uniform(-0.4, 0.4, 3))
        task = Task('soft wire', rod, hole, start, _SOFT_DEPTH * length)
        inverse = InverseSimulator(DirectSimulator(rod, obstacles=task.obstacles))
        try:
            plan = inverse.plan(Thread(hole, np.linspace(0, task.depth, WAYPOINTS)), start=start)
        except (Infeasible, NotConverged):
            continue
        if plan.misalignment.max() > _OBLIQUE:
            return task


def _held(rng: np.random.Generator, name: str, rod: Rod, radius: float) -> OtherTask:
    """Return the task to lay a DLO over a bar so that a point of it touches."""
    thick, half = _BAR
    turn = Rotation.from_euler('z', rng.uniform(-0.3, 0.3)).as_matrix()
    contact = Pose.from_rotation(np.array([0.0, 0.0, 1.0]), turn)
    axis = half * turn[:, 1]
    middle = contact.position - thick * turn[:, 2]
    s = rng.uniform(0.6, 0.75) * rod.length
    back, up, aside = rng.uniform(0.7, 0.8), rng.uniform(0.75, 0.95), rng.uniform(-0.1, 0.1)
    start = Pose.looking_along(contact.position + turn @ (-back * rod.length, aside, up),
                               turn @ (1.0, rng.uniform(-0.1, 0.1), rng.uniform(0.0, 0.4)))
    return OtherTask(name, rod, CutOut(contact, radius=radius), start, rod.length - s, HoldContact(
        contact, s, 'least_force'), Capsule(middle - axis, middle + axis, thick))
