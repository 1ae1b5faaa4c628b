# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Looking ahead: shapes of steps to come, roughly, from a shape that is known; what workers do."""

from typing import NamedTuple

import numpy as np

from dlo_planner.direct.integrator import KinematicState, Scheme
from dlo_planner.direct.memory import Memory
from dlo_planner.direct.statics import TOLERANCE
from dlo_planner.direct.stepper import StepMemory
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.minimize.classic import approximate
from dlo_planner.model.arrays import Floats
from dlo_planner.parallel.pieces import Shared

UNLIMITED = 1_000_000  # more work than anything takes


class Moving(NamedTuple):
    """A DLO in motion, several steps in one.

    Attributes
    ----------
    stepper : Shared
        Shared Stepper.
    nodes, bends : KinematicState
        Those of now.
    memory : StepMemory
        What is left to the next step.
    place : float
        Where to look, in instants.
    scheme : Scheme
        Scheme of one step from now to there.
    strains : ndarray, shape (N, 3)
        Strains in 1/m, where the search begins.
    most : int
        Work, in the unit of `minimize.classic.approximate`.
    """

    stepper: Shared
    nodes: KinematicState
    bends: KinematicState
    memory: StepMemory
    place: float
    scheme: Scheme
    strains: Floats
    most: int


class Resting(NamedTuple):
    """A DLO that is moved slowly, several steps in one.

    Attributes
    ----------
    simulator : Shared
        Shared DirectSimulator.
    rotation : ndarray, shape (3, 3)
        Rotation of the gripper there.
    history : Memory
        Memory of now.
    strains : ndarray
        As for Moving.
    most : int
        As for Moving.
    """

    simulator: Shared
    rotation: Floats
    history: Memory
    strains: Floats
    most: int


class Guess(NamedTuple):
    """What was seen: strains (N, 3) in 1/m, and the work that it took."""

    strains: Floats
    work: int


def look(task: Moving | Resting) -> Guess:
    """Return the Guess that a task asks for."""
    if isinstance(task, Moving):
        stepper = task.stepper.content
        method = stepper.method
        system = stepper.problem(task.nodes, task.bends, task.memory, task.place, task.scheme)
        rounding = stepper.rounding(task.scheme)
    else:
        simulator = task.simulator.content
        method, rounding = simulator.method, 0.0
        system = simulator.mesh.system(task.rotation, history=task.history)
    q = np.empty((system.basis.shape[1] or system.lengths.size, 3))
    unknowns_of(system, np.array(task.strains), q)
    return Guess(*approximate(system, q, method, TOLERANCE + rounding, task.most))
