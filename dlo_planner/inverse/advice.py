# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What would have to change so that a DLO which is refused goes through a hole.

Three levers: to hold it nearer to its end, to turn the sheet downwards, to make the hole larger.
Each is sought by halving with the search of `inverse.most_room`, and tried by a plan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.most_room import (
    RoomSearch,
    RoomyWay,
    search_of,
    thread_with_most_room,
)
from dlo_planner.inverse.route import Threading
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.pose import Pose, turned_by
from dlo_planner.progress import Progress

_HALVINGS = 12      # of what is left of a lever's range, at most:
_PRECISION = 0.03   # until what is said is known to this part: a length, or by how much to turn
_SHORTEST = 0.05    # of the length: what a hand can hold on to is longer
_WIDEST = 8.0       # times the size of the hole
_SIZES = 12         # of holes, from the widest on: the first for which the sheet is large enough
_UPRIGHT = 1e-3     # of the way to straight down: there all headings are alike, and are tried
_BACK = 5           # steps back from what the search found, each twice the one before, until a plan
# What DLOs pass holes whose normals rise by these angles, degrees, has such a weight times the
# square of its free length by its bending stiffness, about (60 random ones): a first guess
_RISES = np.array([-10.0, 0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0])
_LOADS = np.array([80.0, 50.0, 33.0, 25.0, 20.0, 15.5, 13.0, 10.5, 8.0])
_TINY = 1e-9  # such a load: none
_NEAR = 0.07, np.deg2rad(2.0)  # first steps from there: part of the length, angle


class _Lever(NamedTuple):
    """A lever x, which helps the more the smaller it is."""

    easy: float              # the least
    refused: float           # where there is no plan
    guess: float             # where a search begins,
    step: float              # with this step, then twice that
    exact: Callable[[float], float]  # how exactly the bound is wanted that is at x, about


def advice(simulator: DirectSimulator, task: Threading, most: float) -> str:
    """Return in words what would let a DLO through the hole of a Threading that is refused.

    `most`: largest angle at which the DLO may pass, rad. '' if none of the levers helps. It is
    asked for after the plan has been refused: the deadline of the plan does not hold for it.
    """
    task = replace(task, demands=replace(task.demands, progress=Progress()))
    search = search_of(simulator, task)  # of the levers of the hole
    found = [words for words in (_held_nearer(simulator, task, most),
                                 _turned(simulator, task, most, search),
                                 _larger(simulator, task, most, search)) if words]
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

    last: dict[float, RoomSearch] = {}  # by which there was a way: for the plan

    def passes(free: float) -> bool:
        shorter, short = held(free)
        search = search_of(shorter, short)
        if not _leads(search, short, most):
            return False
        last.clear()
        last[free] = search
        return True

    # of uniform ones: the load grows as the length, and takes its square
    guess = np.interp(_rise(simulator, task), _RISES, _LOADS) / max(_load(simulator), _TINY)
    free = _bound(passes, lambda free: _planned(*held(free), most, last.get(free)), _Lever(
        _SHORTEST * length, length, float(np.cbrt(guess)) * length, _NEAR[0] * length,
        lambda free: _PRECISION * free))
    return '' if free is None else f'if held at most {_said(free, np.floor)} m from its end'


def _turned(simulator: DirectSimulator, task: Threading, most: float, search: RoomSearch) -> str:
    """Return by how much the sheet would have to be turned downwards, in words."""
    up, cutout = _up(simulator), task.cutouts[0]
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

    guess = 0.5 * np.pi + np.deg2rad(np.interp(-_load(simulator), -_LOADS, _RISES))
    left = _bound(lambda left: _leads(search, turned(left), most),
                  lambda left: _planned(simulator, turned(left), most, search), _Lever(
                      _UPRIGHT * furthest, furthest, float(guess), float(_NEAR[1]),
                      lambda left: _PRECISION * (furthest - left)))
    return '' if left is None else ('with the sheet turned downwards by '
                                    f'{_said(np.rad2deg(furthest - left), np.ceil)} degrees')


def _larger(simulator: DirectSimulator, task: Threading, most: float, search: RoomSearch) -> str:
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
        lambda part: _leads(search, scaled(part), most),
        lambda part: _planned(simulator, scaled(part), most, search), _Lever(
            widest, 1.0, widest, np.inf, lambda part: _PRECISION * part))
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


def _bound(passes: Callable[[float], bool], planned: Callable[[float], bool],
           lever: _Lever) -> float | None:
    """Return the largest value of a lever with which there is a plan, about; None: there is none.

    It `passes` where a search finds a way.
    """
    x, step = min(max(lever.guess, lever.easy), lever.refused - lever.step), lever.step
    x = max(x, lever.easy)
    good, bad = -np.inf, lever.refused
    while not (good > -np.inf and bad < lever.refused):  # from the guess to both sides
        if passes(x):
            good, x = x, x + step
        elif x == lever.easy:
            return None
        else:
            bad, x = x, max(x - step, lever.easy)
        if x >= lever.refused:
            break
        step *= 2
    for _ in range(_HALVINGS):
        if bad - good <= lever.exact(good):
            break
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if passes(middle) else (good, middle)
    if planned(good):
        return good
    found: float = good
    doublings = 0
    while True:
        found, missed = max(found - 2**doublings * lever.exact(good), lever.easy), found
        if planned(found):
            break
        doublings += 1
        if doublings == _BACK:
            return None
    for _ in range(doublings):
        middle = 0.5 * (missed + found)
        found, missed = (middle, missed) if planned(middle) else (found, middle)
    return found


def _up(simulator: DirectSimulator) -> Floats:
    """Return a unit vector (3,) against gravity."""
    up = -np.asarray(simulator.surroundings.gravity)
    return up / np.linalg.norm(up) if up.any() else np.array([0.0, 0.0, 1.0])


def _rise(simulator: DirectSimulator, task: Threading) -> float:
    """Return by how much the normal of the hole rises, degrees."""
    return float(np.rad2deg(np.arcsin(np.clip(task.cutouts[0].normal @ _up(simulator), -1, 1))))


def _load(simulator: DirectSimulator) -> float:
    """Return the load on a DLO times the square of its length by its bending stiffness."""
    rod, load = simulator.rod, float(np.linalg.norm(simulator.mesh.load))
    return load * rod.length**2 / float(min(rod.stiffness[1:]))


def _leads(search: RoomSearch, task: Threading, most: float) -> bool:
    """Return whether a search finds a way."""
    return isinstance(search.way(task, most, rated=False), RoomyWay)


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
