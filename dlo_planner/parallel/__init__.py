# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many at once: shapes and plans by all cores of a machine, or of a cluster (extra `[cluster]`)."""

from typing import Any

from dlo_planner.extras import studied
from dlo_planner.parallel.batch import map, solve_many
from dlo_planner.parallel.capability import CapabilityMap, CellGrid, capability_map
from dlo_planner.parallel.shapes import Shapes
from dlo_planner.parallel.which_grasp import GraspMap, which_grasp

__all__ = ['CapabilityMap', 'CellGrid', 'GraspMap', 'Shapes', 'capability_map', 'map',
           'solve_many', 'speculative', 'which_grasp']


def __getattr__(name: str) -> Any:
    if name == 'speculative':  # of the paper: read when it is asked for
        return studied('speculation.speculative')
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
