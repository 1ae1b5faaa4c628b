# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The base of tasks: a value that states what the DLO has to do, and how it is solved."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.plain_tasks import from_plain, to_plain
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, row, shown
from dlo_planner.model.value import Value
from dlo_planner.plan.plan import Plan

_WAYPOINTS = 40
_DEEPEST = 0.95  # of the length, where no depths are given
MOST = 10_000    # waypoints of a plan, or forces


class Task(Value, ABC):
    """Base of all tasks: `@dataclass(frozen=True, eq=False, repr=False)` with two methods.

    `__post_init__` checks the attributes, once, and ends with `super().__post_init__()`; `solve`
    returns the Plan. Such a task can be planned, pickled, compared, and written as plain Python
    or YAML; a user's own class as well.

    Attributes
    ----------
    touches : ClassVar
        Whether plans of the class mean to touch the simulator's obstacles; if not, they avoid them.
    takes_initial : ClassVar
        Whether plans of the class depend on the present shape, `initial`.
    """

    touches: ClassVar[bool] = False
    takes_initial: ClassVar[bool] = False

    @abstractmethod
    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan.

        Raises
        ------
        InvalidTask
            The task makes no sense for this DLO; the message names the argument.
        Infeasible
            There is no such plan; carries the part of it that there is.
        """

    def to_dict(self) -> dict[str, Any]:
        """Return the task as dicts, lists, numbers and strings, for JSON and YAML.

        Each value in it is a dict with the name of its class under 'type'; a Pose is
        {'position', 'quaternion'}.

        Raises
        ------
        InvalidTask
            The task holds a function, which cannot be written.
        """
        content: dict[str, Any] = to_plain(self)
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> 'Task':
        """Return the task that `to_dict` wrote; its class has to be imported.

        Raises
        ------
        InvalidTask
            The content does not describe a task; the message says what is missing.
        """
        task = from_plain('content', instance('content', content, Mapping))
        if not isinstance(task, cls):
            raise InvalidTask(f'content = {shown(content)}: expected a {cls.__name__}')
        return task


def depths_or_none(name: str, depths: object) -> Floats | None:
    """Return depths (n,), m, which must not decrease; or None, for the default of `depths_on`."""
    if depths is None:
        return None
    depths = row(name, depths, most=MOST, minimum=0)
    if (np.diff(depths) < 0).any():
        bad = int(np.argmax(np.diff(depths) < 0)) + 1
        raise InvalidTask(f'{name}[{bad}] = {depths[bad]}: expected not less than the one before')
    return depths


def depths_on(length: float, depths: Floats | None) -> Floats:
    """Return the depths (n,) of a task, m, on a DLO of this length; None: 40 of them to 0.95 L."""
    if depths is None:
        return np.linspace(0, _DEEPEST * length, _WAYPOINTS)
    return row('depths', depths, most=MOST, minimum=0, maximum=length)
