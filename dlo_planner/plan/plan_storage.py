# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans as arrays for files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.shape import pack, unpack
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose

if TYPE_CHECKING:
    from dlo_planner.plan.plan import Plan

_ARRAYS = {'depths': 'depths', 'misalignment': 'misalignment', 'miss': 'position_error',
           'times': 'times', 'clearances': 'clearances', 'stops': 'stops',
           'insertion_force': 'insertion_force'}  # in a file: in a Plan


def plan_arrays(plan: Plan) -> dict[str, NDArray[Any]]:
    """Return a dict of arrays that hold all of a Plan but the rods of its shapes."""
    arrays = {key: np.asarray(getattr(plan, name)) for key, name in _ARRAYS.items()}
    arrays['grippers'] = np.array([_pose(gripper) for gripper in plan.grippers]).reshape(-1, 7)
    arrays['fraction'], arrays['status'] = np.asarray(plan.fraction), np.asarray(plan.status.value)
    arrays['passes'] = np.array([
        [k, *center, s, *(np.full(3, np.nan) if normal is None else normal)]
        for k, points in enumerate(plan.via_points) for center, s, normal in points]).reshape(-1, 8)
    arrays['sheets'] = np.asarray(json.dumps([
        {**_sheet(sheet), 'normal': list(normal)} for sheet, normal in plan.sheets]))
    for k, shape in enumerate(plan.shapes):
        arrays |= pack(shape, f'{k}/')
    return arrays


def plan_contents(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return a dict of what a Plan is made of, from the arrays of `plan_arrays`."""
    grippers = [_read_pose(row) for row in arrays['grippers']]
    via_points: list[list[tuple[Floats, float, Floats | None]]] = [[] for _ in grippers]
    for k, *numbers in arrays['passes']:
        normal = np.array(numbers[4:])
        via_points[int(k)].append((np.array(numbers[:3]), float(numbers[3]),
                               None if np.isnan(normal).any() else normal))
    shapes = []
    for k in range(len(grippers)):
        mark = f'{k}/'
        shapes.append(unpack({key[len(mark):]: value for key, value in arrays.items()
                                     if key.startswith(mark)}))
    sheets = [(_read_sheet(one), np.array(one['normal']))
              for one in json.loads(str(arrays['sheets']))]
    known = {name: arrays[key] for key, name in _ARRAYS.items() if key in arrays}
    return {**known, 'grippers': grippers, 'shapes': shapes, 'sheets': sheets,
            'via_points': [tuple(one) for one in via_points],
            'fraction': float(arrays['fraction']),
            'stops': tuple(int(stop) for stop in arrays['stops'])}


def _pose(pose: Pose) -> list[float]:
    return [*map(float, pose.position), *map(float, pose.quaternion)]


def _read_pose(numbers: Sequence[float]) -> Pose:
    return Pose(numbers[:3], numbers[3:])


def _sheet(sheet: Sheet) -> dict[str, Any]:
    return {'pose': _pose(sheet.pose), 'width': sheet.width, 'height': sheet.height,
            'thickness': sheet.thickness, 'friction': sheet.friction, 'cutouts': [
                {'pose': _pose(one.pose), 'radius': one.radius, 'width': one.width,
                 'height': one.height} for one in sheet.cutouts]}


def _read_sheet(known: Mapping[str, Any]) -> Sheet:
    cutouts = [CutOut(**{**one, 'pose': _read_pose(one['pose'])}) for one in known['cutouts']]
    return Sheet(_read_pose(known['pose']), cutouts=cutouts,
                 **{name: known[name] for name in ('width', 'height', 'thickness', 'friction')})
