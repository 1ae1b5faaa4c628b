# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Penalties of a shape, their search, and what penalties of one's own are made of."""

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.inverse.tasks.minimize import PenaltyResult, minimize_penalty
from dlo_planner.model.value import Value, put
from dlo_planner.plan.goals import (
    AwayFrom,
    BentAtMost,
    DirectionAt,
    FrameAt,
    GripperNear,
    InHole,
    KeepTangent,
    PositionAt,
    Through,
)

__all__ = ['AwayFrom', 'BentAtMost', 'DirectionAt', 'FrameAt', 'GripperNear', 'InHole',
           'KeepTangent', 'PenaltyResult', 'PositionAt', 'Sensitivity', 'Through', 'Value',
           'minimize_penalty', 'put']
