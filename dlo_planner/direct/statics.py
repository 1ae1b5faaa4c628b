# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium: from a gripper's pose and a discretization to a Shape with its proof."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.acting import ACTING
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.far_hold import Limits, limits_of
from dlo_planner.direct.hinge import pinned_newton
from dlo_planner.direct.history import History
from dlo_planner.direct.moments import balanced
from dlo_planner.direct.part import Solved
from dlo_planner.direct.proof import CONVERGED, proved, stored_after, violation
from dlo_planner.direct.shape import Shape, made_shape
from dlo_planner.direct.state import State
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.system import State as KernelState
from dlo_planner.energy.system import System
from dlo_planner.minimize.hanging import hang
from dlo_planner.minimize.holding import hold_on
from dlo_planner.minimize.methods import search
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.multipliers import constrained_newton
from dlo_planner.minimize.newton import NEUTRAL, newton
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze

Found: TypeAlias = tuple[Any, ...]  # what `minimize.hanging.hang` returns

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
EXACT = 1e-10      # of the length: violation of a constraint aimed at
_ELSEWHERE = 0.1   # of the length: a shape in contact that moves so far is another one
MAX_ITERATIONS = 1000
_NO_PAST = np.zeros((0, 6))  # nothing has touched: where it was does not matter


def equilibrium(discretization: Discretization, gripper: Pose, strains: Floats,
                method: str = 'newton', history: History | None = None,
                far_end: FarEnd | None = None) -> tuple[Shape, int]:
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Parameters
    ----------
    discretization : Discretization
    gripper : Pose
    strains : ndarray, shape (N, 3)
        Of the elements, 1/m, where the descent starts.
    method : str, optional
        One of METHODS.
    history : History or None, optional
        History on the same mesh. If None, no past.
    far_end : FarEnd or None, optional
    """
    if method == 'newton' and far_end is None and discretization.hangs:
        return hanging(discretization, gripper, strains)
    system = discretization.system(gripper.rotation, gripper.position, history, far_end)
    q = discretization.unknowns(strains)
    if method != 'newton':
        found = search(system, q, method, TOLERANCE)
        return shape_of(discretization, gripper, found, history), found.kicks
    most, exact = limits_of(discretization, gripper, far_end, Limits(MAX_ITERATIONS, EXACT))
    found = solve(discretization, system, gripper, q, history, Search(most, exact=exact))
    return shape_of(discretization, gripper, found, history, far_end), found.kicks


def hanging(discretization: Discretization, gripper: Pose, strains: Floats,
            near: Shape | None = None, most: float = np.inf) -> tuple[Shape, int]:
    """Return what `equilibrium` does for a DLO that hangs freely, see `Discretization.hangs`.

    Parameters
    ----------
    strains : ndarray
        As in `equilibrium`.
    near : Shape or None, optional
        Shape on the same mesh. Where it is left by more than `most` (rad, of a node in the
        gripper), the search is given up.
    """
    frames, before, nodes = NO_FRAMES, gripper.rotation, NO_NODES
    if near is not None and most < np.inf:
        frames, before, nodes = near.frames, near.gripper.rotation, discretization.sampled
    if strains.flags.writeable:  # another type for kernels
        strains = np.array(strains)
        freeze(strains)
    found = hang(discretization.static, gripper.rotation, gripper.position, strains, TOLERANCE,
                 MAX_ITERATIONS, frames, before, nodes, most)
    return found_hanging(discretization, gripper, found), found[-1]


def found_hanging(discretization: Discretization, gripper: Pose, found: Found) -> Shape:
    """Return the Shape of a DLO that hangs freely with its error, as `hanging_shape` without."""
    estimate = partial(_estimate_hanging, discretization, gripper, found[0], found[2])
    return hanging_shape(discretization, gripper, found, 0.0, estimate)


def unknown() -> float:
    """Return the error of what is not estimated by itself."""
    return np.inf


def hanging_shape(discretization: Discretization, gripper: Pose, found: Found, rounding: float,
                  estimate: Callable[[], float] = unknown) -> Shape:
    """Return the Shape of a DLO that hangs freely, or on which nothing acts that may.

    Parameters
    ----------
    found : tuple
        What `minimize.hanging.hang` returns.
    rounding : float
        Rounding error of the residual, where it is larger than usual.
    estimate : callable, optional
        Function that returns its error, m.
    """
    (strains, frames, positions, wrench, elastic, energy, residual, stability, iterations,
     _) = found
    before = past = discretization.start
    if not discretization.hangs:  # where something acts, the next step counts from here
        past = before.followed(positions, frames[:, :, 0].copy())
    return made_shape(
        gripper=gripper, s=discretization.s, positions=positions, frames=frames,
        element_strains=strains, energy=energy, elastic_energy=elastic, gripper_wrench=wrench,
        residual=residual, stability=stability, iterations=iterations,
        converged=bool(hangs_still(residual - 100 * rounding, stability)), far_wrench=_NOTHING,
        state=State.made(discretization, past, before, estimate))


def hangs_still(residual: Any, stability: Any) -> Any:
    """Whether a DLO that hangs freely is in a stable or neutral equilibrium."""
    return (residual < CONVERGED) & (stability > -NEUTRAL)


def _estimate_hanging(discretization: Discretization, gripper: Pose, strains: Floats,
                      positions: Floats) -> float:
    return estimated(discretization, gripper, strains, positions - gripper.position, None, None)


NO_NODES: Ints = np.zeros(0, dtype=np.int64)  # of no Leash
NO_FRAMES = np.zeros((0, 3, 3))
freeze(NO_FRAMES)


class Search(NamedTuple):
    """Until when a minimum is sought.

    Attributes
    ----------
    steps : int
        Newton steps at most.
    check : bool
        Whether its stability is looked at, and what is unstable left.
    exact : float
        Part of the length by which constraints may be violated.
    rounding : float
        Rounding error of the residual, where it is larger than usual.
    """

    steps: int = MAX_ITERATIONS
    check: bool = True
    exact: float = EXACT
    rounding: float = 0.0


THOROUGH = Search()


def held_nearby(mesh: Discretization, gripper: Pose, far_end: FarEnd, strains: Floats,
                force: Floats) -> list[Any] | None:
    """Return what `minimize.holding.hold_on` finds next to given strains; None if it is not near.

    Parameters
    ----------
    mesh : Discretization
    gripper : Pose
    far_end : FarEnd
    strains : ndarray, shape (N, 3)
        Strains of the elements, 1/m, read-only.
    force : ndarray, shape (K,)
        Forces of the far end's grip before, N, read-only.
    """
    length = float(mesh.s[-1])
    limits = limits_of(mesh, gripper, far_end, Limits(MAX_ITERATIONS, EXACT))
    if not mesh.hangs or limits.steps < MAX_ITERATIONS:  # out of reach
        return None
    rows = far_end.held
    if force.shape != (len(rows),):
        return None
    rows[:, :3] *= mesh.lever
    exact = limits.exact * length
    found, *held = hold_on(
        mesh.full, gripper.rotation, gripper.position, far_end.pose.position,
        far_end.pose.rotation, far_end.share, rows, strains, force, TOLERANCE, exact)
    return held if found else None


def solve(discretization: Discretization, system: System, gripper: Pose, q: Floats,
          history: History | None, how: Search = THOROUGH) -> Minimum:
    """Return the Minimum that is reached from q (m, 3) and the past `history` or None."""
    most, check, exact, rounding = how
    before = _NO_PAST
    if history is not None and len(history.positions):
        before = np.hstack([history.positions - gripper.position, history.tangents])
    newtons = pinned_newton if discretization.surroundings.pinned else constrained_newton

    def solved(system: System, q: Floats) -> Minimum:
        return newtons(system, q, TOLERANCE + rounding, most, check,
                       exact * discretization.s[-1], before)

    if discretization.surroundings.has_moments:
        return balanced(solved, system, q, discretization.moments)
    return solved(system, q)


def shape_of(mesh: Discretization, gripper: Pose, found: Minimum, history: History | None = None,
             far_end: FarEnd | None = None, rounding: float = 0.0) -> Shape:
    """Return the Shape of a kernel's result.

    Parameters
    ----------
    found : Minimum
    rounding : float, optional
        Rounding error of the residual, where it is larger than usual.
    """
    state, system = found.state, found.system
    if mesh.surroundings.pinned:
        gripper = Pose.from_rotation(gripper.position, system.base)
    history = history or mesh.start
    solved = Solved(mesh, system, state, gripper, far_end, history.left)
    positions = state.positions + gripper.position
    past = History.after(solved, positions, state.rotations[:, :, 0].copy())
    elastic = stored_after(solved, past.left)
    energy = (elastic + float(np.vdot(system.load.pull, state.positions))
              + float(mesh.load @ gripper.position))
    reports = {name: value for part in ACTING
               for name, value in part.reports(solved, past.left).items()}
    estimate = partial(estimated, mesh, gripper, state.strains, state.positions, history, far_end)
    return Shape(gripper, mesh.s, positions, state.rotations, state.strains, energy,
                 elastic, _wrench(mesh, state), float(found.residual),
                 float(found.stability), int(found.iterations), proved(solved, found, rounding),
                 evaluations=found.evaluations, violation=violation(solved, found), far_end=far_end,
                 state=State.made(mesh, past, history, estimate), **reports)


_NOTHING = np.zeros(6)


def _wrench(discretization: Discretization, state: KernelState) -> Floats:
    """Return force and moment (6,) on the DLO at its gripper."""
    moment = state.base_moment
    if discretization.surroundings.has_moments:
        moment = moment - discretization.moments.sum(axis=0)
    return np.concatenate([state.base_force, moment])


def estimated(discretization: Discretization, gripper: Pose, strains: Floats, positions: Floats,
              history: History | None, far_end: FarEnd | None) -> float:
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.
    """
    finer = discretization.finer
    past, halved = finer.past(history), np.repeat(strains, 2, axis=0)
    freeze(halved)
    held = None if far_end is None else held_nearby(finer, gripper, far_end, halved,
                                                    past.left['hold'])
    if held is not None:
        there = held[2] - gripper.position
    else:
        system = finer.system(gripper.rotation, gripper.position, past, far_end)
        q = np.empty((finer.n_unknowns, 3))
        unknowns_of(system, halved.copy(), q)
        if discretization.hangs and far_end is None:
            there = newton(system, q, 1e-9, 4, False).state.positions
        else:
            found = solve(finer, system, gripper, q, past)
            there = found.state.positions
            if not proved(Solved(finer, found.system, found.state, gripper, far_end, past.left),
                          found):
                return np.inf
    moved = np.linalg.norm(there[::2] - positions, axis=1).max()
    may_let_go = any(part.lets_go and part.acts(discretization.surroundings) for part in ACTING)
    if may_let_go and moved > _ELSEWHERE * discretization.s[-1]:
        return np.inf
    rounding = 1e-15 * discretization.s.size * discretization.s[-1]
    return float(4 / 3 * moved + rounding)
