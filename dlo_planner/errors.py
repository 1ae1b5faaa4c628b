"""Everything that `dlo_planner` raises on purpose; each error carries its evidence."""


class DloPlannerError(Exception):
    """Base of all errors of this package."""


class InvalidRod(DloPlannerError, ValueError):
    """A property of the DLO makes no sense; the message names it, its value and what is right."""


class InvalidTask(DloPlannerError, ValueError):
    """A pose, cut-out, option or request makes no sense; the message says which and why."""


class NotConverged(DloPlannerError):
    """The minimiser ended without an equilibrium where one was indispensable.

    Attributes:
        shape: the last shape, with `converged` False and its residual (None if there is none)
    """

    def __init__(self, message, shape=None):
        super().__init__(message)
        self.shape = shape


class Infeasible(DloPlannerError):
    """The task has no admissible solution from some waypoint on.

    Attributes:
        waypoint: index of the first waypoint that cannot be had
        constraint: short name of what is violated, e.g. 'stability'
        amount: by how much, in the constraint's own unit (see `constraint`)
        plan: the plan up to that waypoint (`fraction` < 1), as evidence; may be None
    """

    def __init__(self, message, waypoint, constraint, amount, plan=None):
        super().__init__(message)
        self.waypoint = waypoint
        self.constraint = constraint
        self.amount = amount
        self.plan = plan
