# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw the DLO over an obstacle."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from numpy.typing import ArrayLike

from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.contact.hold_and_slide import CONDITIONS, slide_contact
from dlo_planner.inverse.solvers.contact.straight import slide_straight
from dlo_planner.inverse.task import MOST, Task
from dlo_planner.inverse.tasks.hold_contact import check_obstacles, checked_forces, checked_least
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan

_MODES = {'aligned': slide_contact, 'straight': slide_straight}


@dataclass(frozen=True, eq=False, repr=False)
class SlideContact(Task):
    """Slide along one contact; `InverseSimulator.slide_contact` says what the attributes mean.

    Attributes
    ----------
    contact : Pose
        Pose on the surface of an obstacle: x axis along the DLO, z axis outwards.
    lengths : ndarray, shape (n,)
        Arc lengths between gripper and contact, m, one after the other.
    condition : str
        'least_energy', 'least_force', 'least_motion', 'largest_clearance'.
    forces : ndarray, shape (n,) or None
        Forces in N: only these are examined. If None, all.
    mode : str
        'aligned' or 'straight'.
    min_force : float or None
        Least force of the contact, N. If None, a tenth of weight + EI / L^2.
    """

    touches: ClassVar[bool] = True

    contact: Pose
    lengths: Floats
    condition: str = 'least_motion'
    forces: Floats | None = None
    mode: str = 'aligned'
    min_force: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, contact: Pose, lengths: ArrayLike, condition: str = 'least_motion',
                     forces: ArrayLike | None = None, mode: str = 'aligned',
                     min_force: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, lengths=row('lengths', self.lengths, most=MOST, above=0),
            forces=checked_forces(self.forces), min_force=checked_least(self.min_force))
        choice('condition', self.condition, CONDITIONS)
        choice('mode', self.mode, tuple(_MODES))
        instance('contact', self.contact, Pose)
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        row('lengths', self.lengths, most=MOST, above=0, below=context.rod.length)
        check_obstacles(context)
        return _MODES[self.mode](context.simulator, self, context.start, context.demands)
