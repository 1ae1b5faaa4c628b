# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What would have to change so that a DLO which is refused goes through a hole.

Three levers: to hold it nearer to its end, to turn the sheet downwards, to make the hole larger.
Each is sought by halving with the search of `inverse.most_room`, and tried by a plan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.most_room import RoomSearch, RoomyWay, thread_with_most_room
from dlo_planner.inverse.route import Threading, quick_simulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.pose import Pose, turned_by

_DEPTHS = 12        # that are looked at
_HALVINGS = 8       # of a lever's range, 1 % of it
_SHORTEST = 0.05    # of the length: what a hand can hold on to is longer
_WIDEST = 8.0       # times the size of the hole
_BACK = 0.97, 0.94  # parts of a lever that are tried by a plan, from what the search found


def advice(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return in words what would let a DLO through the hole of a Threading that is refused.

    `most`: largest angle at which the DLO may pass, rad. '' if none of the levers does.
    """
    found = [words for words in (_held_nearer(simulator, task, most),
                                 _turned(simulator, task, most),
                                 _larger(simulator, task, most)) if words]
    return f'it would pass {", or ".join(found)}' if found else ''


def _held_nearer(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return at which distance from its end the DLO would have to be held, in words."""
    length, around = simulator.rod.length, simulator.surroundings

    def held(free: float) -> tuple[DirectSimulator, Threading]:
        part = around.part(length - free, 1)
        shorter = DirectSimulator(part.rod, accuracy=simulator.accuracy and min(
            simulator.accuracy, 1e-3 * free), gravity=part.gravity, load=part.load,
            point_loads=part.point_loads)
        short = _with(task, task.cutouts[0])
        return shorter, replace(short, depths=free / length * task.depths,
                                demands=short.demands.made_with(shorter))

    free = _bound(lambda free: _passes(*held(free), most), length, _SHORTEST * length,
                  lambda free: _planned(*held(free), most))
    return '' if free is None else f'if held at most {free:.3g} m from its end'


def _turned(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return by how much the sheet would have to be turned downwards, in words."""
    up = -np.asarray(simulator.surroundings.gravity)
    up = up / np.linalg.norm(up) if up.any() else np.array([0.0, 0.0, 1.0])
    cutout = task.cutouts[0]
    across = np.cross(up, cutout.normal)
    if np.linalg.norm(across) < 1e-9:
        across = np.array(cutout.pose.rotation[:, 1])
    across = across / np.linalg.norm(across)
    furthest = float(np.pi - np.arccos(np.clip(cutout.normal @ up, -1, 1)))
    if furthest < 1e-3:
        return ''
    search = _search(simulator, task)

    def turned(left: float) -> Threading:
        pose = Pose.from_rotation(cutout.center, turned_by((furthest - left) * across)
                                  @ cutout.pose.rotation)
        return _with(task, replace(cutout, pose=pose))

    left = _bound(lambda left: isinstance(search.way(turned(left), most), RoomyWay), furthest, 0.0,
                  lambda left: _planned(simulator, turned(left), most))
    return '' if left is None else ('with the sheet turned downwards by '
                                    f'{np.rad2deg(furthest - left):.3g} degrees')


def _larger(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return how large the hole would have to be, in words."""
    cutout, search = task.cutouts[0], _search(simulator, task)

    def scaled(part: float) -> Threading:
        return _with(task, replace(cutout, **{
            name: size / part for name in ('radius', 'width', 'height')
            if (size := getattr(cutout, name)) is not None}))

    part = _bound(lambda part: isinstance(search.way(scaled(part), most), RoomyWay), 1.0,
                  1 / _WIDEST, lambda part: _planned(simulator, scaled(part), most))
    if part is None:
        return ''
    if cutout.radius is not None:
        return f'through a hole of radius {cutout.radius / part:.3g} m'
    assert cutout.width is not None  # it has a size
    assert cutout.height is not None
    return f'through a hole of {cutout.width / part:.3g} m by {cutout.height / part:.3g} m'


def _bound(passes: Callable[[float], bool], refused: float, easy: float,
           planned: Callable[[float], bool]) -> float | None:
    """Return the value of a lever nearest to `refused` with which there is a plan, or None."""
    if not passes(easy):
        return None
    good, bad = easy, refused
    for _ in range(_HALVINGS):
        middle = np.sqrt(good * bad) if easy > 0 else 0.5 * (good + bad)
        good, bad = (middle, bad) if passes(middle) else (good, middle)
    return next((value for part in (1.0, *_BACK)
                 if planned(value := easy + part * (good - easy))), None)


def _search(simulator: DirectSimulator, task: Threading) -> RoomSearch:
    return RoomSearch(quick_simulator(simulator), task.demands, np.linspace(
        task.depths[0], task.depths[-1], min(_DEPTHS, len(task.depths))), rated=False)


def _passes(simulator: DirectSimulator, task: Threading, most: float) -> bool:
    return isinstance(_search(simulator, task).way(task, most), RoomyWay)


def _planned(simulator: DirectSimulator, task: Threading, most: float) -> bool:
    try:
        thread_with_most_room(simulator, task, most)
    except Infeasible:
        return False
    return True


def _with(task: Threading, cutout: CutOut) -> Threading:
    """Return a Threading through another hole of the same sheet, begun anywhere."""
    old, demands = task.cutouts[0], task.demands
    turn = cutout.pose.rotation @ old.pose.rotation.T

    def moved(one: Obstacle) -> Obstacle:
        if not (isinstance(one, Sheet) and old in one.cutouts):
            return one
        return replace(one, pose=_about(old.center, turn, one.pose), cutouts=tuple(
            cutout if hole == old else replace(hole, pose=_about(old.center, turn, hole.pose))
            for hole in one.cutouts))

    sheets = replace(demands.silent(), obstacles=tuple(map(moved, demands.obstacles)))
    return replace(task, cutouts=(cutout,), demands=sheets, start=None, initial=None)


def _about(center: Floats, turn: Floats, pose: Pose) -> Pose:
    """Return a Pose turned about a center (3,)."""
    return Pose.from_rotation(center + turn @ (pose.position - center), turn @ pose.rotation)
