"""A plan as the smooth motion that is executed: timed so that the DLO arrives calm, and verified."""

from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.path import GripperPath
from dlo_planner.inverse.plan import Plan
from dlo_planner.inverse.timed_path import TimedPath, fastest_law
from dlo_planner.model.checks import instance


class Trajectory(TimedPath):
    def __init__(self, plan: Plan, limits: Limits | None = None):
        instance('plan', plan, Plan)
        limits = Limits() if limits is None else instance('limits', limits, Limits)
        path = GripperPath.of(plan)
        super().__init__(path, tuple(fastest_law(leg, limits) for leg in path.legs), limits)
