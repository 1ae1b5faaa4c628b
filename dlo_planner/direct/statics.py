# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium: from a gripper's pose and a discretization to a Shape with its proof."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.ball_joint import pinned_newton
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.memory import ACTING, Memory
from dlo_planner.direct.shape import NO_WRENCH, Shape, State
from dlo_planner.direct.terms import Left, Limits, Solved, limits_of
from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.plastic import yields
from dlo_planner.energy.potential import configuration_at, evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration as KernelState
from dlo_planner.energy.problem import Problem, new_configuration
from dlo_planner.energy.terms import stored
from dlo_planner.geometry.so3 import jacobians, matrix, plus, put_vector, transposed_applied, vector
from dlo_planner.kernels import kernel
from dlo_planner.minimize.classic import search
from dlo_planner.minimize.contact_solver import constrained_newton
from dlo_planner.minimize.convergence import CONVERGED, Minimum, is_stationary
from dlo_planner.minimize.newton import HELD_NEUTRAL, NEUTRAL, newton
from dlo_planner.minimize.solve import solve_between_grips, solve_free
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import freeze

KEPT = 1e-6        # of the length: violation that still counts as converged


def proved(solved: Solved, found: Minimum) -> bool:
    """Return whether a Minimum is a stable or neutral equilibrium that keeps all constraints."""
    mesh, system = solved.mesh, solved.system
    bound = mesh.surroundings.pinned or any(part.constrains(system) for part in ACTING)
    return bool(is_stationary(system, solved.state, float(found.residual), 0.0)
                and found.stability > -(HELD_NEUTRAL if bound else NEUTRAL)
                and all(part.kept(solved) for part in ACTING)
                and violation(solved, found) <= KEPT * mesh.s[-1])


def violation(solved: Solved, found: Minimum) -> float:
    """Return by how much a constraint is violated at most, m."""
    return max(float(found.violation), *(part.violation(solved) for part in ACTING))


def stored_after(solved: Solved, left: Left) -> float:
    """Return the energy in J that is stored in the DLO after a step."""
    mesh, system, state = solved.mesh, solved.system, solved.state
    if mesh.isometric and not mesh.stores and np.array_equal(system.natural, mesh.natural):
        return 0.5 * float(np.vdot(state.q, state.q))  # what the unknowns are scaled for
    return elastic_energy(mesh, state.strains, left)


def elastic_energy(mesh: Discretization, strains: Floats, left: Left) -> float:
    """Return the energy in J that is stored at strains (N, 3), after what effects have left."""
    system = mesh.static
    if not mesh.stores:
        bent = strains - system.natural
        return 0.5 * float(np.sum(system.lengths[:, None] * system.stiffness * bent**2))
    strains = strains.copy()
    return sum((part.stored(mesh, left, strains) for part in mesh.stores),
               stored(system.effects, system, strains))


_ROUNDS = 60
_REMEMBERED = 8   # rounds that tell the next one where to go
_SETTLED = 1e-10  # part of the moments by which they may still turn


def balanced(solved: Callable[[Problem, Floats], Minimum], system: Problem, q: Floats,
             moments: Floats) -> Minimum:
    """Return what `solved` returns in equilibrium with dead moments, its residual theirs too.

    The fixed point of frames -> shape -> frames is sought by Anderson's acceleration.

    Shapes: q (m, 3), moments (N + 1, 3).
    """
    free, unit = system, np.abs(moments).sum()
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    known = _couples(system.lengths, state.strains, state.rotations, moments) / unit
    strains, iterations = state.strains, 0
    tried: list[Floats] = []
    missed: list[Floats] = []
    for _ in range(_ROUNDS):
        loaded = _pulled(system, free, unit * known)
        found = solved(loaded, configuration_at(loaded, strains).q)
        state, system = found.state, found.system
        iterations += found.iterations
        strains = state.strains
        miss = _couples(system.lengths, strains, state.rotations, moments) / unit - known
        off = np.abs(miss).max()
        if off <= _SETTLED:
            break
        tried, missed = [*tried, known][-_REMEMBERED:], [*missed, miss][-_REMEMBERED:]
        known = _next(tried, missed)
    return found._replace(residual=max(found.residual, off), iterations=iterations)


def _pulled(system: Problem, free: Problem, couples: Floats) -> Problem:
    """Return a Problem like `system`, but that couples (N, 3) in N m pull at the strains of `free`.

    What cannot yield is as though its natural strains were others.
    """
    if yields(free.plastic):
        return system._replace(elastic=with_couples(free.elastic, couples))
    return system._replace(natural=free.natural + couples / free.stiffness)


def _next(tried: list[Floats], missed: list[Floats]) -> Floats:
    """Return where the misses (n, 3) would vanish, by least squares over what was tried."""
    best = tried[-1] + missed[-1]
    if len(tried) == 1:
        return best
    of_misses = np.column_stack([(one - missed[-1]).ravel() for one in missed[:-1]])
    share, *_ = np.linalg.lstsq(of_misses, -missed[-1].ravel(), rcond=1e-10)
    for part, one, miss in zip(share, tried[:-1], missed[:-1], strict=True):
        best = best + part * (one + miss - tried[-1] - missed[-1])
    return best


@kernel
def _couples(lengths: Floats, strains: Floats, rotations: Floats, moments: Floats) -> Floats:
    """Return (N, 3): the work of all moments beyond, per length and strain of each element, N m."""
    out = np.empty(strains.shape)
    beyond = (0.0, 0.0, 0.0)
    for e in range(lengths.size - 1, -1, -1):
        h = lengths[e]
        beyond = plus(beyond, vector(moments[e + 1]))
        turning, _ = jacobians(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h)
        own = transposed_applied(matrix(rotations[e]), beyond)
        put_vector(transposed_applied(turning, own), out[e])
    return out


Found: TypeAlias = tuple[Any, ...]  # what `minimize.solve.solve_free` returns

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
EXACT = 1e-10      # of the length: violation of a constraint aimed at
_ELSEWHERE = 0.1   # of the length: a shape in contact that moves so far is another one
MAX_ITERATIONS = 1000
_NO_PAST = np.zeros((0, 6))  # nothing has touched: where it was does not matter


def equilibrium(discretization: Discretization, gripper: Pose, strains: Floats,
                method: str = 'newton', history: Memory | None = None,
                far_end: FarEnd | None = None) -> tuple[Shape, int]:
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Shapes: strains (N, 3).
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
    """Return what `equilibrium` does for a DLO that hangs freely, see `Discretization.hangs`."""
    frames, before, nodes = NO_FRAMES, gripper.rotation, NO_NODES
    if near is not None and most < np.inf:
        frames, before, nodes = near.frames, near.gripper.rotation, discretization.sampled
    if strains.flags.writeable:  # another type for kernels
        strains = np.array(strains)
        freeze(strains)
    found = solve_free(discretization.static, gripper.rotation, gripper.position, strains,
                       TOLERANCE, MAX_ITERATIONS, frames, before, nodes, most)
    return hanging_shape(discretization, gripper, found), found[-1]


class Solution(NamedTuple):
    """What a search found, as attributes of a Shape; nodes and forces in world axes.

    Attributes
    ----------
    element_strains, frames, positions, gripper_wrench : ndarray
    elastic_energy, energy, residual, stability : float
    iterations : int
    converged : bool
        Whether it is a stable or neutral equilibrium that keeps all constraints.
    evaluations : int
    violation : float
    far_wrench : ndarray
    contacts : tuple
    dissipated : float
    """

    element_strains: Floats
    frames: Floats
    positions: Floats
    gripper_wrench: Floats
    elastic_energy: float
    energy: float
    residual: float
    stability: float
    iterations: int
    converged: bool
    evaluations: int = 0
    violation: float = 0.0
    far_wrench: Floats = NO_WRENCH
    contacts: tuple[Any, ...] = ()
    dissipated: float = 0.0


class Way(NamedTuple):
    """The past that a step begins with, that it leaves, and what holds the far end then."""

    before: Memory
    after: Memory
    far_end: FarEnd | None = None


def shape_from(mesh: Discretization, gripper: Pose, solution: Solution, way: Way,
               estimate: Callable[[], float] | None = None) -> Shape:
    """Return the Shape of a Solution on a mesh: all that simulators return are made here."""
    for array in solution[:4]:
        array.flags.writeable = False
    if estimate is None:
        estimate = partial(estimated, mesh, gripper, solution.element_strains, solution.positions,
                           way.before, way.far_end)
    return Shape(gripper=gripper, s=mesh.s, far_end=way.far_end,
                 state=State(mesh, way.after, way.before, estimate), **solution._asdict())


def unknown() -> float:
    """Return the error of what is not estimated by itself."""
    return np.inf


def hanging_shape(mesh: Discretization, gripper: Pose, found: Found) -> Shape:
    """Return the Shape of a DLO that hangs freely, or on which nothing acts that may."""
    (strains, frames, positions, wrench, elastic, energy, residual, stability, steps,
     _) = found
    after = mesh.start
    if not mesh.hangs:  # where something acts, the next step counts from here
        after = after.followed(positions, frames[:, :, 0].copy())
    good = bool(hangs_still(residual, stability))
    solution = Solution(strains, frames, positions, wrench, elastic, energy, residual, stability,
                        steps, good)
    return shape_from(mesh, gripper, solution, Way(mesh.start, after))


def hangs_still(residual: Any, stability: Any) -> Any:
    """Whether a DLO that hangs freely is in a stable or neutral equilibrium."""
    return (residual < CONVERGED) & (stability > -NEUTRAL)


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
    tolerance : float
        Residual that is sought.
    """

    steps: int = MAX_ITERATIONS
    check: bool = True
    exact: float = EXACT
    tolerance: float = TOLERANCE


THOROUGH = Search()


def held_nearby(mesh: Discretization, gripper: Pose, far_end: FarEnd, strains: Floats,
                force: Floats) -> list[Any] | None:
    """Return what `solve_between_grips` finds next to given strains; None if it is not near.

    Shapes: strains (N, 3), force (K,).
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
    found, *held = solve_between_grips(
        mesh.full, gripper.rotation, gripper.position, far_end.pose.position,
        far_end.pose.rotation, far_end.share, rows, strains, force, TOLERANCE, exact)
    return held if found else None


def solve(discretization: Discretization, system: Problem, gripper: Pose, q: Floats,
          history: Memory | None, how: Search = THOROUGH) -> Minimum:
    """Return the Minimum that is reached from q (m, 3) and the past `history` or None."""
    most, check, exact, tolerance = how
    before = _NO_PAST
    if history is not None and len(history.positions):
        before = np.hstack([history.positions - gripper.position, history.tangents])
    newtons = pinned_newton if discretization.surroundings.pinned else constrained_newton

    def solved(system: Problem, q: Floats) -> Minimum:
        return newtons(system, q, tolerance, most, check,
                       exact * discretization.s[-1], before)

    if discretization.surroundings.has_moments:
        return balanced(solved, system, q, discretization.moments)
    return solved(system, q)


def shape_of(mesh: Discretization, gripper: Pose, found: Minimum, history: Memory | None = None,
             far_end: FarEnd | None = None) -> Shape:
    """Return the Shape of a kernel's result."""
    state, system = found.state, found.system
    if mesh.surroundings.pinned:
        gripper = Pose.from_rotation(gripper.position, system.base)
    history = history or mesh.start
    solved = Solved(mesh, system, state, gripper, far_end, history.left)
    positions = state.positions + gripper.position
    past = Memory.after(solved, positions, state.rotations[:, :, 0].copy())
    elastic = stored_after(solved, past.left)
    energy = (elastic + float(np.vdot(system.load.pull, state.positions))
              + float(mesh.load @ gripper.position))
    reports: dict[str, Any] = {name: value for part in ACTING
                               for name, value in part.reports(solved, past.left).items()}
    solution = Solution(
        state.strains, state.rotations, positions, _wrench(mesh, state), elastic, energy,
        float(found.residual), float(found.stability), int(found.iterations),
        proved(solved, found), evaluations=found.evaluations,
        violation=violation(solved, found), **reports)
    return shape_from(mesh, gripper, solution, Way(history, past, far_end))


def _wrench(discretization: Discretization, state: KernelState) -> Floats:
    """Return force and moment (6,) on the DLO at its gripper."""
    moment = state.base_moment
    if discretization.surroundings.has_moments:
        moment = moment - discretization.moments.sum(axis=0)
    return np.concatenate([state.base_force, moment])


def estimated(discretization: Discretization, gripper: Pose, strains: Floats, positions: Floats,
              history: Memory | None, far_end: FarEnd | None) -> float:
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.
    """
    finer, hangs = discretization.finer, discretization.hangs and far_end is None
    past, halved = finer.past(None if hangs else history), np.repeat(strains, 2, axis=0)
    freeze(halved)
    held = None if far_end is None else held_nearby(finer, gripper, far_end, halved,
                                                    past.left['hold'])
    if held is not None:
        there = held[2] - gripper.position
    else:
        system = finer.system(gripper.rotation, gripper.position, past, far_end)
        q = np.empty((finer.n_unknowns, 3))
        unknowns_of(system, halved.copy(), q)
        if hangs:
            there = newton(system, q, 1e-9, 4, False).state.positions
        else:
            found = solve(finer, system, gripper, q, past)
            there = found.state.positions
            if not proved(Solved(finer, found.system, found.state, gripper, far_end, past.left),
                          found):
                return np.inf
    moved = np.linalg.norm(there[::2] + gripper.position - positions, axis=1).max()
    may_let_go = any(part.lets_go and part.acts(discretization.surroundings) for part in ACTING)
    if may_let_go and moved > _ELSEWHERE * discretization.s[-1]:
        return np.inf
    rounding = 1e-15 * discretization.s.size * discretization.s[-1]
    return float(4 / 3 * moved + rounding)
