# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks beyond those of the package itself: what plans keep, tasks of one's own, tasks as files."""

from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.inverse.tasks.carry import Carry
from dlo_planner.inverse.tasks.insert_plug import InsertPlug
from dlo_planner.inverse.tasks.move_to import MoveTo
from dlo_planner.inverse.tasks.route import Clip, Fitting, Fork, Peg, Route
from dlo_planner.inverse.tasks.thread_in_grasps import ThreadInGrasps
from dlo_planner.inverse.tasks.thread_sequence import threading_of
from dlo_planner.model.plug import Plug
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.plan import PlanStatus, concatenate
from dlo_planner.plan.requirements import Requirements
from dlo_planner.plan.waypoint import Waypoint, waypoint_at
from dlo_planner.settings.tasks import read_task, task_from_yaml, task_to_yaml, write_task

__all__ = ['Approach', 'Carry', 'Clip', 'Fitting', 'Fork', 'InsertPlug', 'MoveTo', 'Peg',
           'PlanBuilder', 'PlanContext', 'PlanStatus', 'Plug', 'Requirements', 'Route', 'Task',
           'ThreadInGrasps', 'Waypoint', 'concatenate', 'put', 'read_task', 'task_from_yaml',
           'task_to_yaml', 'threading_of', 'waypoint_at', 'write_task']
