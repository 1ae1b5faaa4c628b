# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Reports as arrays for files, their Trajectories among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.plan.leg import Leg
from dlo_planner.plan.motion.calm_search import COMPLETE
from dlo_planner.plan.motion.in_motion import InMotion
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.shift import Shift
from dlo_planner.plan.motion.time_law import TimeLaw
from dlo_planner.plan.motion.trajectory import NOT_SIMULATED, Trajectory, restored
from dlo_planner.plan.path import GripperPath

if TYPE_CHECKING:
    from dlo_planner.verify.report import ValidationReport

_LEG, _LAW = ('knots', 'positions', 'rotations'), ('parameters', 'rates', 'windows')
_SHIFT = ('knots', 'coefficients')
_RENAMED = {'miss': 'position_error', 'dynamic_miss': 'max_tracking_error'}  # in older files
_OTHERS = ('trajectory', 'not_looked_at')  # fields that are no numbers or texts


def report_arrays(report: ValidationReport) -> dict[str, NDArray[Any]]:
    """Return a dict of arrays that hold all of a ValidationReport."""
    arrays = {item.name: getattr(report, item.name) for item in fields(report)
              if item.name not in _OTHERS}
    arrays['not_looked_at'] = np.array(report.not_looked_at, dtype=str)
    if report.trajectory is not None:
        arrays |= {f'trajectory/{name}': array
                   for name, array in _trajectory_arrays(report.trajectory).items()}
    return {name: np.asarray(array) for name, array in arrays.items()}


def report_contents(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return a dict of the fields of a ValidationReport, from the arrays of `report_arrays`."""
    own = {_RENAMED.get(name, name): array for name, array in arrays.items() if '/' not in name}
    contents = {name: array.item() for name, array in own.items() if name not in _OTHERS}
    contents['not_looked_at'] = tuple(_RENAMED.get(name, name)
                                      for name in own['not_looked_at'].tolist())
    inside = _under('trajectory', arrays)
    return contents | {'trajectory': _trajectory(inside) if inside else None}


def _trajectory_arrays(trajectory: Trajectory) -> dict[str, Any]:
    arrays = {'times': trajectory.path.times, 'limits': trajectory.limits.sizes,
              'tolerance': trajectory.tolerance, 'mode_margin': trajectory.mode_margin,
              'status': trajectory.status, 'legs': len(trajectory.laws)}
    if trajectory.motion is not None:
        arrays |= {f'motion/{item.name}': getattr(trajectory.motion, item.name)
                   for item in fields(InMotion)}
    for k, (leg, law) in enumerate(zip(trajectory.path.legs, trajectory.laws, strict=True)):
        arrays |= {f'{k}/leg/{name}': getattr(leg, name) for name in _LEG}
        if law is not None:
            arrays |= {f'{k}/law/{name}': getattr(law, name) for name in _LAW}
            if law.shift is not None:
                arrays |= {f'{k}/shift/{name}': getattr(law.shift, name) for name in _SHIFT}
    return arrays


def _trajectory(arrays: Mapping[str, Any]) -> Trajectory:
    legs, laws = [], []
    for k in range(int(arrays['legs'])):
        law, shift = _under(f'{k}/law', arrays), _under(f'{k}/shift', arrays)
        legs.append(Leg(**_under(f'{k}/leg', arrays)))
        laws.append(TimeLaw(**law, shift=Shift(**shift) if shift else None) if law else None)
    motion = {_RENAMED.get(name, name): array.item()
              for name, array in _under('motion', arrays).items()}
    limits = dict(zip([item.name for item in fields(Limits)], arrays['limits'].ravel().tolist(),
                      strict=True))
    return restored(
        GripperPath(arrays['times'], tuple(legs)), tuple(laws), Limits(**limits),
        float(arrays['tolerance']), InMotion(**motion) if motion else None,
        float(arrays['mode_margin']),
        # older files do not say
        str(arrays.get('status', COMPLETE if motion else NOT_SIMULATED)))


def _under(mark: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arrays whose names begin with `mark` and a slash, by what follows it."""
    mark += '/'
    return {name[len(mark):]: array for name, array in arrays.items() if name.startswith(mark)}
