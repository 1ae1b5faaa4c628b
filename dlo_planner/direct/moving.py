# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The part of a simulator that simulates motions: what they begin with, and by which steps."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from dlo_planner.direct.beginning import (
    Velocity,
    first_shape,
    last_of,
    motion_tolerance,
    moving_mesh,
    nodes_velocity,
    refuse_motion,
)
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.dynamics import simulate
from dlo_planner.direct.grips import ends_of, moving_grips, poses
from dlo_planner.direct.integrator import INTEGRATORS
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.motion_error import Begun, Recipe
from dlo_planner.direct.one_step import How, step
from dlo_planner.direct.setup import Setup
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.stepping import Stepper
from dlo_planner.model.checks import choice, number
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.progress import Progress

_ENOUGH = 64  # nodes of a mesh that a motion is begun with as it is


class Prescribed(NamedTuple):
    """A prescribed motion: the arguments of `DirectSimulator.simulate`, not yet judged."""

    grippers: Iterable[Pose]
    dt: float
    initial: Shape | Motion | None = None
    far_ends: Iterable[Any] | None = None
    velocity: Velocity | None = None
    tolerance: float | None = None
    integrator: str = 'generalized_alpha'


class Moving(Setup):
    """The motions of a DirectSimulator; a base of it."""

    def _motion(self, make: Callable[..., Stepper], task: Prescribed, steps: Progress) -> Motion:
        """Return what `DirectSimulator.simulate` does; `make` makes the Stepper."""
        grippers = poses(task.grippers, 1)
        dt = number('dt', task.dt, above=0)
        tolerance = motion_tolerance(task.tolerance, self.rod.length)
        choice('integrator', task.integrator, INTEGRATORS)
        refuse_motion(self.surroundings, self.strains)
        initial, velocity = last_of(task.initial, task.velocity)
        self._check(grippers[0], initial)
        ends = ends_of(task.far_ends, len(grippers))
        for gripper, end in zip(grippers, ends, strict=True):
            self._check(gripper, None, end)
            self._judge_end(end)
        grips = moving_grips(grippers, ends, dt, velocity is None, initial)
        start, mesh = self._beginning(grippers[0], ends[0], initial)
        begun = Begun(initial, start, nodes_velocity(velocity, initial, start))
        plan = Recipe(len(grippers), task.integrator, tolerance)
        return simulate(make(mesh, grips, dt, self.method), begun, plan, steps)

    def _beginning(self, gripper: Pose, far_end: FarEnd | None,
                   initial: Shape | None) -> tuple[Shape, Discretization]:
        """Return the Shape at time 0 of a motion and the Discretization for the rest of it."""
        mesh = self._discretization
        known = initial
        if self.accuracy is not None:
            known, _ = self._equilibrium(gripper, initial, far_end)
            if known.state.mesh is not mesh or mesh.s.size <= _ENOUGH:
                mesh = moving_mesh(known.state.made_on)
        if initial is not None:
            return first_shape(mesh, gripper, far_end, initial, self._history), mesh
        if self.accuracy is None:
            return self._equilibrium(gripper, None, far_end)[0], mesh
        return step(mesh, gripper, known, How(self._history, far_end, self.method))[0], mesh


def motion_by(make: Callable[..., Stepper], simulator: Moving, task: Prescribed,
              steps: Progress) -> Motion:
    """Return what `DirectSimulator.simulate` does, with another Stepper.

    Parameters
    ----------
    make : callable
        Makes the Stepper, of its mesh, grips, period and method.
    simulator : DirectSimulator
    task : Prescribed
    steps : Progress
    """
    return simulator._motion(make, task, steps)
