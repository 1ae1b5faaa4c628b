# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a simulator knows of an effect: how its Record is made, what it leaves and what it reports.

The kernels of an effect are in `energy`; what a Discretization, a past and a Shape have to do with
it is a subclass of Part, listed in `direct.acting`. Nothing else knows effects by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.system import State, System
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.ritz.record import Record

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization

Left: TypeAlias = Mapping[str, Any]  # arrays by name: what effects leave to the next step


class Held(NamedTuple):
    """Where a DLO is held: the gripper's position (3,) in m, if it matters; FarEnd or None."""

    origin: Floats | None = None
    far_end: FarEnd | None = None


class Solved(NamedTuple):
    """A step as a minimizer left it.

    Attributes
    ----------
    mesh : Discretization
    system : System
        With the multipliers as they are at the end.
    state : State
        That of the kernels, nodes relative to the gripper.
    gripper : Pose
        Of the DLO's beginning.
    far_end : FarEnd or None
    left : Left
        What was left to the step.
    """

    mesh: Discretization
    system: System
    state: State
    gripper: Pose
    far_end: FarEnd | None
    left: Left


class Part:
    """An effect as simulators know it; as written here, one that leaves and reports nothing.

    Attributes
    ----------
    name : str
        Its name in `energy.effects.EFFECTS`.
    of_rod : bool
        Whether what it leaves belongs to the rod, wherever that is taken; else to all that acts.
    lets_go : bool
        Whether it may let go of a DLO that differs a little, so that its shape is another one.
    stores : bool
        Whether it stores energy in the DLO where it acts, and moves the stress-free strains.
    rests : bool
        Whether it leaves and reports nothing new where it does not act, or its grip is free.
    residual : float
        Residual that is promised where it constrains the DLO.
    """

    name: str = ''
    of_rod: bool = False
    lets_go: bool = False
    stores: bool = False
    rests: bool = False
    residual: float = 1e-8

    def acts(self, around: Surroundings) -> bool:
        """Whether a DLO in these Surroundings does not hang freely because of it."""
        return False

    def given(self, mesh: Discretization) -> Any:
        """Return what depends on neither grips nor past: the mesh keeps it (`mesh.given`)."""
        return None

    def record(self, mesh: Discretization, left: Left, held: Held) -> Record | None:
        """Return its Record where the DLO is held there, after what is left to it; or None."""
        raise NotImplementedError

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether its Record depends on what is left and how the DLO is held there."""
        return False

    def placed(self, mesh: Discretization, base: Floats, left: Left,
               held: Held) -> System | None:
        """Return the System in a gripper of rotation `base` (3, 3), if it alone changes; or None.

        None where there is no quicker way to it than by `record`.
        """
        return None

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return what it leaves where nothing has happened yet, on nodes `s` (N + 1,), m."""
        return {}

    def judged(self, left: Left, nodes: int) -> Left:
        """Return what a file says that it left on so many nodes; raise InvalidTask as `filed`."""
        return {}

    def resampled(self, left: Left, s: Floats, wanted: Floats) -> Left:
        """Return what it left on nodes `s` (N + 1,) as it is on nodes `wanted` (n + 1,), m."""
        return {}

    def fits(self, left: Left, start: Left) -> bool:
        """Whether what is left may be of a DLO whose beginning, without a past, is `start`."""
        return True

    def cleared(self, left: Left) -> Left:
        """Return what it left as if it had not acted."""
        return {}

    def idle(self, left: Left) -> bool:
        """Whether what it left has no say in the next step."""
        return True

    def lasts(self, left: Left) -> bool:
        """Whether it left anything for good."""
        return False

    def leaves(self, solved: Solved) -> Left:
        """Return what it leaves to the next step."""
        return {}

    def underway(self, solved: Solved) -> Left:
        """Return what it leaves to another part of the same step."""
        return {}

    def with_contacts(self, before: Left, after: Left) -> Left:
        """Return what it left before a step, with the forces after it."""
        return {}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return attributes of the Shape by name; `left` is what the step leaves."""
        return {}

    def constrains(self, system: System) -> bool:
        """Whether it constrains the DLO there."""
        return False

    def violation(self, solved: Solved) -> float:
        """Return by how much it is violated, m, besides `Minimum.violation`."""
        return 0.0

    def kept(self, solved: Solved) -> bool:
        """Whether its own limits are kept, besides that of all violations."""
        return True

    def stored(self, mesh: Discretization, left: Left, strains: Floats) -> float:
        """Return the energy in J that it stores at strains (N, 3), 1/m."""
        return 0.0

    def strains(self, mesh: Discretization, left: Left) -> Floats:
        """Return by how much it moves the stress-free strains (N, 3), 1/m."""
        return np.zeros_like(mesh.natural)


def filed(left: Left, name: str, shape: tuple[int, ...], *, kind: type = float,
          lowest: float = -np.inf, highest: float = np.inf) -> Any:
    """Return an array of what a file says was left, with numbers of a `kind`, float or int.

    Raises
    ------
    InvalidTask
        It is not there, has another shape, or numbers that are not finite, or beyond the limits:
        kernels would take them as they are.
    """
    value = np.asarray(left.get(name, ()))
    if (name not in left or value.shape != shape
            or value.dtype.kind not in ('iu' if kind is int else 'iuf')
            or not np.isfinite(value).all() or (value < lowest).any() or (value > highest).any()):
        limits = '' if lowest == -np.inf else f' from {lowest:g} to {highest:g}'
        raise InvalidTask(f'past_{name} = {shown(value.tolist())}: expected finite '
                          f'{"integers" if kind is int else "numbers"} of shape {shape}{limits}')
    return value.astype(kind)
