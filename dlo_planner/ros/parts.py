# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the parts of the node share."""

from dataclasses import dataclass

from dlo_planner.ros.frames import OneFrame
from dlo_planner.ros.health import Health
from dlo_planner.ros.picture import Picture
from dlo_planner.ros.reporter import Reporter
from dlo_planner.ros.state import Store


@dataclass(frozen=True)
class Parts:
    """The one Store, Health, Reporter, Picture and OneFrame of the node."""

    store: Store
    health: Health
    reporter: Reporter
    picture: Picture
    frames: OneFrame
