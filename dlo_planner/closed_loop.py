# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The closed loop for a robot and a camera of one's own: what the node runs, without ROS."""

from dlo_planner.execute.causes import Cause
from dlo_planner.execute.guards import Feedback, Guards
from dlo_planner.execute.loop_motions import LoopTask
from dlo_planner.execute.task_loop import TaskLoop
from dlo_planner.identify.entries import SeenMiss, centered, seen_miss
from dlo_planner.identify.estimator import DloEstimator, EstimatorConfig

__all__ = ['Cause', 'DloEstimator', 'EstimatorConfig', 'Feedback', 'Guards', 'LoopTask', 'SeenMiss',
           'TaskLoop', 'centered', 'seen_miss']
