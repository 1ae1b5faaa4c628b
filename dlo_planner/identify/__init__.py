# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From observations: properties of a DLO, a running estimate, a corrected plan."""

from dlo_planner.identify.closed_loop import Phase
from dlo_planner.identify.correction import Correction, correct
from dlo_planner.identify.estimate import Estimate, PredictedMiss
from dlo_planner.identify.fit import Fit
from dlo_planner.identify.observation import Observation, ObservedMotion, gripper_at
from dlo_planner.identify.online_trajectory import CorrectedTrajectory

__all__ = ['CorrectedTrajectory', 'Correction', 'Estimate', 'Fit', 'Observation', 'ObservedMotion',
           'Phase', 'PredictedMiss', 'correct', 'gripper_at']

Steered = CorrectedTrajectory  # its earlier name, for one release
