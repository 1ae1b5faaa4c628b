# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Reports as arrays for files, their Trajectories among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.plan.motion.trajectory import trajectory_arrays, trajectory_of, under

if TYPE_CHECKING:
    from dlo_planner.verify.report import ValidationReport

_OTHERS = ('trajectory', 'not_looked_at')  # fields that are no numbers or texts


def report_arrays(report: ValidationReport) -> dict[str, NDArray[Any]]:
    """Return a dict of arrays that hold all of a ValidationReport."""
    arrays = {item.name: getattr(report, item.name) for item in fields(report)
              if item.name not in _OTHERS}
    arrays['not_looked_at'] = np.array(report.not_looked_at, dtype=str)
    if report.trajectory is not None:
        arrays |= {f'trajectory/{name}': array
                   for name, array in trajectory_arrays(report.trajectory).items()}
    return {name: np.asarray(array) for name, array in arrays.items()}


def report_contents(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return a dict of the fields of a ValidationReport, from the arrays of `report_arrays`."""
    own = {name: array for name, array in arrays.items() if '/' not in name}
    contents = {name: array.item() for name, array in own.items() if name not in _OTHERS}
    contents['not_looked_at'] = tuple(own['not_looked_at'].tolist())
    inside = under('trajectory', arrays)
    return contents | {'trajectory': trajectory_of(inside) if inside else None}
