# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Hold the DLO in contact with an obstacle."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.contact.hold_and_slide import CONDITIONS, hold_contact
from dlo_planner.inverse.task import MOST, Task
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan


@dataclass(frozen=True, eq=False, repr=False)
class HoldContact(Task):
    """Hold one contact; `InverseSimulator.hold_contact` says what the attributes mean.

    Attributes
    ----------
    contact : Pose
        Pose on the surface of an obstacle: x axis along the DLO, z axis outwards.
    s : float
        Arc length of the contact, m.
    condition : str or None
        'least_energy', 'least_force', 'least_motion', 'largest_clearance'. If None, all.
    forces : ndarray, shape (n,) or None
        Forces in N: only these are examined. If None, all.
    min_force : float or None
        Least force of the contact, N. If None, a tenth of weight + EI / L^2.
    """

    touches: ClassVar[bool] = True

    contact: Pose
    s: float
    condition: str | None = 'least_energy'
    forces: Floats | None = None
    min_force: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, contact: Pose, s: float, condition: str | None = 'least_energy',
                     forces: ArrayLike | None = None, min_force: float | None = None
                     ) -> None: ...

    def __post_init__(self) -> None:
        put(self, s=number('s', self.s, above=0), forces=checked_forces(self.forces),
            min_force=checked_least(self.min_force))
        instance('contact', self.contact, Pose)
        if self.condition is not None:
            choice('condition', self.condition, CONDITIONS)
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        number('s', self.s, above=0, below=context.rod.length)
        check_obstacles(context)
        if self.condition == 'least_motion' and context.start is None:
            raise InvalidTask('start = None: expected a Pose with condition \'least_motion\'')
        return hold_contact(context.simulator, self, context.start, context.demands)


def checked_forces(forces: object) -> Floats | None:
    """Return the forces (n,) to be examined, N, or None (all)."""
    return None if forces is None else row('forces', forces, most=MOST, above=0)


def checked_least(force: object) -> float | None:
    """Return the least force of a contact, N, or None (of the DLO's own scale)."""
    return None if force is None else number('min_force', force, minimum=0)


def check_obstacles(context: PlanContext) -> None:
    """Raise InvalidTask if the simulator has no obstacle to touch."""
    if not context.simulator.obstacles:
        raise InvalidTask('simulator has no obstacles: expected the one to touch among them')
