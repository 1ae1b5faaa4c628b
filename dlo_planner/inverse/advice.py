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
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.most_room import (
    RoomSearch,
    RoomyWay,
    search_of,
    thread_with_most_room,
)
from dlo_planner.inverse.route import Threading, quick_simulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.pose import Pose, turned_by
from dlo_planner.progress import Progress

_DEPTHS = 12        # that are looked at
_HALVINGS = 12      # of a lever's range at most:
_PRECISION = 0.02   # until the bound is known to a part of itself and of how far the lever is moved
_SHORTEST = 0.05    # of the length: what a hand can hold on to is longer
_WIDEST = 8.0       # times the size of the hole
_SIZES = 12         # of holes, from the widest on: the first for which the sheet is large enough
_BACK = 0.005       # of the range: back from what the search found by this, then by twice as much
_FARTHEST = 0.15    # each, until there is a plan, by this at most
_CLOSER = 2         # halvings of the last step back


def advice(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return in words what would let a DLO through the hole of a Threading that is refused.

    `most`: largest angle at which the DLO may pass, rad. '' if none of the levers helps. It is
    asked for after the plan has been refused: the deadline of the plan does not hold for it.
    """
    task = replace(task, demands=replace(task.demands, progress=Progress()))
    shapes = _search(simulator, task), search_of(simulator, task)  # of the levers of the hole
    found = [words for words in (_held_nearer(simulator, task, most),
                                 _turned(simulator, task, most, *shapes),
                                 _larger(simulator, task, most, *shapes)) if words]
    return f'it would pass {", or ".join(found)}' if found else ''


def _held_nearer(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return how near to its end the DLO would have to be held, in words."""
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
    return '' if free is None else f'if held at most {_said(free, np.floor)} m from its end'


def _turned(simulator: DirectSimulator, task: Threading, most: float, search: RoomSearch,
            exact: RoomSearch) -> str:
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

    def turned(left: float) -> Threading:
        pose = Pose.from_rotation(cutout.center, turned_by((furthest - left) * across)
                                  @ cutout.pose.rotation)
        return _with(task, replace(cutout, pose=pose))

    left = _bound(lambda left: isinstance(search.way(turned(left), most), RoomyWay), furthest, 0.0,
                  lambda left: _planned(simulator, turned(left), most, exact))
    return '' if left is None else ('with the sheet turned downwards by '
                                    f'{_said(np.rad2deg(furthest - left), np.ceil)} degrees')


def _larger(simulator: DirectSimulator, task: Threading, most: float, search: RoomSearch,
            exact: RoomSearch) -> str:
    """Return how large the hole would have to be, in words."""
    cutout = task.cutouts[0]

    def scaled(part: float) -> Threading:
        return _with(task, replace(cutout, **{
            name: size / part for name in ('radius', 'width', 'height')
            if (size := getattr(cutout, name)) is not None}))

    def fits(part: float) -> bool:
        try:
            scaled(part)
        except InvalidTask:  # the sheet is smaller
            return False
        return True

    widest = next((part for part in np.geomspace(1 / _WIDEST, 1.0, _SIZES, endpoint=False)
                   .tolist() if fits(part)), None)
    part = widest and _bound(
        lambda part: isinstance(search.way(scaled(part), most), RoomyWay), 1.0, widest,
        lambda part: _planned(simulator, scaled(part), most, exact))
    if part is None:
        return ''
    if cutout.radius is not None:
        return f'through a hole of radius {_said(cutout.radius / part, np.ceil)} m'
    assert cutout.width is not None  # it has a size
    assert cutout.height is not None
    return (f'through a hole of {_said(cutout.width / part, np.ceil)} m by '
            f'{_said(cutout.height / part, np.ceil)} m')


def _said(value: float, rounded: Callable[[float], float]) -> str:
    """Return a number > 0 with three digits, `rounded` to the side where there is a plan."""
    unit = 10.0**(np.floor(np.log10(value)) - 2)
    return f'{rounded(value / unit) * unit:.3g}'


def _bound(passes: Callable[[float], bool], refused: float, easy: float,
           planned: Callable[[float], bool]) -> float | None:
    """Return the value of a lever nearest to `refused` with which there is a plan, or None."""
    if not passes(easy):
        return None
    good, bad = easy, refused
    for _ in range(_HALVINGS):
        if abs(good - bad) <= _PRECISION * min(abs(good), abs(good - refused)):
            break
        middle = np.sqrt(good * bad) if easy > 0 else 0.5 * (good + bad)
        good, bad = (middle, bad) if passes(middle) else (good, middle)
    if planned(good):
        return good
    found, back, missed = good, _BACK, 0.0

    def value(part: float) -> float:
        return found + part * (easy - found)

    while not planned(value(back)):
        missed, back = back, 2 * back
        if back > _FARTHEST:
            return None
    for _ in range(_CLOSER):
        middle = 0.5 * (missed + back)
        missed, back = (missed, middle) if planned(value(middle)) else (middle, back)
    return value(back)


def _search(simulator: DirectSimulator, task: Threading) -> RoomSearch:
    return RoomSearch(quick_simulator(simulator), task.demands, np.linspace(
        task.depths[0], task.depths[-1], min(_DEPTHS, len(task.depths))), rated=False)


def _passes(simulator: DirectSimulator, task: Threading, most: float) -> bool:
    return isinstance(_search(simulator, task).way(task, most), RoomyWay)


def _planned(simulator: DirectSimulator, task: Threading, most: float,
             search: RoomSearch | None = None) -> bool:
    try:
        thread_with_most_room(simulator, task, most, search)
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
