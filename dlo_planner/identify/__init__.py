# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From observations: properties of a DLO, a running estimate, a corrected plan.

Its names are imported when they are first asked for: its own modules import each other.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_planner.identify.closed_loop import Phase
    from dlo_planner.identify.correction import Correction, correct
    from dlo_planner.identify.estimate import Estimate
    from dlo_planner.identify.fitting import Fit
    from dlo_planner.identify.observation import Observation, ObservedMotion
    from dlo_planner.identify.predicted_miss import PredictedMiss
    from dlo_planner.identify.stamped import gripper_at
    from dlo_planner.identify.steering import Steered

_HOMES = {'Correction': 'correction', 'correct': 'correction', 'Estimate': 'estimate',
          'Fit': 'fitting', 'Observation': 'observation', 'ObservedMotion': 'observation',
          'Phase': 'closed_loop', 'PredictedMiss': 'predicted_miss', 'gripper_at': 'stamped',
          'Steered': 'steering'}
__all__ = ['Correction', 'Estimate', 'Fit', 'Observation', 'ObservedMotion', 'Phase',
           'PredictedMiss', 'Steered', 'correct', 'gripper_at']


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_HOMES[name]}'), name)
