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
_STEP, _STEPS = 0.04, 3  # parts by which a lever is moved on until there is a plan, and no further
_EXACT = 1e-3       # of the length: accuracy of a trial
_VERTICAL = 1e-6    # rad, about


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
    length, around, short = simulator.rod.length, simulator.surroundings, _with(
        task, task.cutouts[0])

    def held(times: float) -> tuple[DirectSimulator, Threading]:
        """Return the DLO that is so many times shorter, and its threading."""
        free = length / times
        part = around.part(length - free, 1)
        shorter = DirectSimulator(part.rod, accuracy=simulator.accuracy and min(
            simulator.accuracy, _EXACT * free), gravity=part.gravity, load=part.load,
            point_loads=part.point_loads)
        return shorter, replace(short, depths=task.depths / times,
                                demands=short.demands.made_with(shorter))

    times = _least_change(lambda times: _passes(*held(times), most),
                          lambda times: times > 1.0 and _planned(*held(times), most),
                          1.0, 1 / _SHORTEST)
    return '' if times is None else f'if held at most {length / times:.3g} m from its end'


def _turned(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return by how much the sheet would have to be turned downwards, in words."""
    cutout, gravity = task.cutouts[0], np.asarray(simulator.surroundings.gravity)
    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])
    across = np.cross(up, cutout.normal)
    if np.linalg.norm(across) < _VERTICAL:
        across = np.array(cutout.pose.rotation[:, 1])
    across = across / np.linalg.norm(across)
    furthest = float(np.pi - np.arccos(np.clip(cutout.normal @ up, -1, 1)))
    search = _search(simulator, task)

    def turned(angle: float) -> Threading:
        return _with(task, replace(cutout, pose=Pose.from_rotation(
            cutout.center, turned_by(angle * across) @ cutout.pose.rotation)))

    angle = None if furthest < _VERTICAL else _least_change(
        lambda angle: isinstance(search.way(turned(angle), most), RoomyWay),
        lambda angle: angle <= furthest and _planned(simulator, turned(angle), most),
        0.0, furthest)
    return '' if angle is None else ('with the sheet turned downwards by '
                                     f'{np.rad2deg(angle):.3g} degrees')


def _larger(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return how large the hole would have to be, in words."""
    cutout, search = task.cutouts[0], _search(simulator, task)

    def scaled(times: float) -> CutOut:
        return replace(cutout, **{name: times * size for name in ('radius', 'width', 'height')
                                  if (size := getattr(cutout, name)) is not None})

    times = _least_change(
        lambda times: isinstance(search.way(_with(task, scaled(times)), most), RoomyWay),
        lambda times: times > 1.0 and _planned(simulator, _with(task, scaled(times)), most),
        1.0, _WIDEST)
    if times is None:
        return ''
    if cutout.radius is not None:
        return f'through a hole of radius {times * cutout.radius:.3g} m'
    one = scaled(times)
    return f'through a hole of {one.width:.3g} m by {one.height:.3g} m'


def _least_change(passes: Callable[[float], bool], planned: Callable[[float], bool],
                  refused: float, furthest: float) -> float | None:
    """Return the least change with which there is a plan, or None; more makes it easier."""
    if not passes(furthest):
        return None
    good, bad = furthest, refused
    for _ in range(_HALVINGS):
        middle = np.sqrt(good * bad) if refused > 0 else 0.5 * (good + bad)
        good, bad = (middle, bad) if passes(middle) else (good, middle)
    # the grid is coarse: what counts is the plan
    tried = float(good)
    if planned(tried):
        while planned(tried * (1 - _STEP)):
            tried *= 1 - _STEP
        return tried
    return next((value for k in range(1, _STEPS)
                 if planned(value := float(good) * (1 + _STEP)**k)), None)


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
