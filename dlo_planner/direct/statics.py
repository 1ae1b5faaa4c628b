# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium: from a gripper's pose and a discretization to a Shape with its proof."""

from functools import partial

import numpy as np

from dlo_planner.direct.contacts import contacts_of, left_by_contacts, left_by_hold
from dlo_planner.direct.hinge import pinned_newton
from dlo_planner.direct.history import History
from dlo_planner.direct.moments import balanced
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.contact import obstructed
from dlo_planner.energy.effects import stored
from dlo_planner.energy.hold import holds
from dlo_planner.energy.hold import violation as hold_violation
from dlo_planner.energy.plastic import add_plastic, settled, yields
from dlo_planner.energy.potential import tip_wrench, unknowns_of
from dlo_planner.minimize.hanging import hang
from dlo_planner.minimize.held import HELD_NEUTRAL
from dlo_planner.minimize.methods import search
from dlo_planner.minimize.multipliers import constrained_newton
from dlo_planner.minimize.newton import NEUTRAL, gradient_noise, newton
from dlo_planner.model.far_end import distance, within_reach
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
CONVERGED = 1e-8   # what is promised
_TOUCHING = 1e-7   # the same among obstacles, whose stiff springs multiply rounding errors
_BLURRED = 1e-5    # a residual that rounding may make larger than this tells nothing
EXACT = 1e-10      # of the length: violation of a constraint aimed at
KEPT = 1e-6        # of the length: violation that still counts as converged
_HELD = 1e-9       # of the length: the same of a held far end
_SLACK = 1e-3      # of its slack: the same, as it pulls the tighter the less there is
_ELSEWHERE = 0.1   # of the length: a shape in contact that moves so far is another one
MAX_ITERATIONS = 1000
_LEAST = 1e-10     # of the length: slack that is looked at
_NO_PAST = np.zeros((0, 6))  # nothing has touched: where it was does not matter
_IN_VAIN = 30      # Newton steps towards what is out of reach


def equilibrium(discretization, gripper, strains, method='newton', history=None, far_end=None):
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Parameters
    ----------
    discretization
        Discretization.
    gripper
        Pose.
    strains
        (N, 3) of the elements, 1/m, where the descent starts.
    method
        One of METHODS.
    history
        History on the same mesh. If None, no past.
    far_end
        FarEnd or None.
    """
    if method == 'newton' and far_end is None and discretization.hangs:
        return hanging(discretization, gripper, strains)
    system = discretization.system(gripper.rotation, gripper.position, history, far_end)
    q = discretization.unknowns(strains)
    if method != 'newton':
        found = search(system, q, method, TOLERANCE)
        return shape_of(discretization, gripper, found, history), found.kicks
    most, exact = MAX_ITERATIONS, EXACT
    if not within_reach(far_end, gripper, discretization.s[-1], discretization.loaded):
        most = _IN_VAIN
    if far_end is not None and discretization.loaded:
        # the less slack, the more its tension depends on where the end is
        length = discretization.s[-1]
        exact = min(exact, 1e-4 * max(1.0 - distance(far_end, gripper) / length, _LEAST))
    found = solve(discretization, system, gripper, q, history, most, exact=exact)
    return shape_of(discretization, gripper, found, history, far_end), found.kicks


def hanging(discretization, gripper, strains, near=None, most=np.inf):
    """Return what `equilibrium` does for a DLO that hangs freely, see `Discretization.hangs`.

    Parameters
    ----------
    strains
        As in `equilibrium`.
    near
        Shape on the same mesh. Where it is left by more than `most` (rad, of a node in the
        gripper), the search is given up.
    """
    frames, before, nodes = NO_FRAMES, gripper.rotation, NO_NODES
    if most < np.inf:
        frames, before, nodes = near.frames, near.gripper.rotation, discretization.sampled
    if strains.flags.writeable:  # another type for kernels
        strains = np.array(strains)
        freeze(strains)
    found = hang(discretization.static, gripper.rotation, gripper.position, strains, TOLERANCE,
                 MAX_ITERATIONS, frames, before, nodes, most)
    return found_hanging(discretization, gripper, found), found[-1]


def found_hanging(discretization, gripper, found):
    """Return the Shape of a DLO that hangs freely with its error, as `hanging_shape` without."""
    estimate = partial(_estimate_hanging, discretization, gripper, found[0], found[2])
    return hanging_shape(discretization, gripper, found, 0.0, estimate)


def unknown():
    """Return the error of what is not estimated by itself."""
    return np.inf


def hanging_shape(discretization, gripper, found, rounding, estimate=unknown):
    """Return the Shape of a DLO that hangs freely.

    Parameters
    ----------
    found
        What `minimize.hanging.hang` returns.
    rounding
        Rounding error of the residual, where it is larger than usual.
    estimate
        Function that returns its error, m.
    """
    (strains, frames, positions, wrench, elastic, energy, residual, stability, iterations,
     _) = found
    past = discretization.start
    return Shape(gripper, discretization.s, positions, frames, strains, energy, elastic, wrench,
                 residual, stability, iterations,
                 bool(hangs_still(residual - 100 * rounding, stability)), far_wrench=_NOTHING,
                 _estimate=estimate, _discretization=discretization, _history=past, _before=past)


def hangs_still(residual, stability):
    """Whether a DLO that hangs freely is in a stable or neutral equilibrium."""
    return (residual < CONVERGED) & (stability > -NEUTRAL)


def _estimate_hanging(discretization, gripper, strains, positions):
    return _estimate(discretization, gripper, strains, positions - gripper.position, None, None)


NO_NODES = np.zeros(0, dtype=np.int64)  # of no Leash
NO_FRAMES = np.zeros((0, 3, 3))
freeze(NO_FRAMES)


def solve(discretization, system, gripper, q, history, most=MAX_ITERATIONS, check=True,
          exact=EXACT, rounding=0.0):
    """Return the Minimum that is reached from q (m, 3) and the past `history` or None.

    Parameters
    ----------
    exact
        Part of the length by which constraints may be violated.
    rounding
        Rounding error of the residual, where it is larger than usual.
    """
    before = _NO_PAST
    if history is not None and len(history.positions) and discretization.surroundings.obstacles:
        before = np.hstack([history.positions - gripper.position, history.tangents])
    newtons = pinned_newton if discretization.surroundings.pinned else constrained_newton

    def solved(system, q):
        return newtons(system, q, TOLERANCE + rounding, most, check,
                       exact * discretization.s[-1], before)

    if discretization.surroundings.has_moments:
        return balanced(solved, system, q, discretization.moments)
    return solved(system, q)


def shape_of(discretization, gripper, found, history=None, far_end=None, rounding=0.0):
    """Return the Shape of a kernel's result.

    Parameters
    ----------
    found
        Minimum.
    rounding
        Rounding error of the residual, where it is larger than usual.
    """
    state, system, stability = found.state, found.system, found.stability
    if discretization.surroundings.pinned:
        gripper = Pose.from_rotation(gripper.position, system.base)
    history = history or discretization.start
    load = discretization.load
    new_set, lost = history.set, 0.0
    if yields(system.plastic):
        new_set, lost = settled(system.lengths, state.strains, system.natural, system.plastic)
    if (discretization.isometric and not yields(system.plastic)
            and np.array_equal(system.natural, discretization.natural)):
        elastic = 0.5 * float(np.vdot(state.q, state.q))  # what the unknowns are scaled for
    else:
        elastic = elastic_energy(discretization, state.strains, new_set)
    energy = (elastic + float(np.vdot(system.load.pull, state.positions))
              + float(load @ gripper.position))
    positions = state.positions + gripper.position
    touching = contacts_of(discretization, system, state, gripper)
    past = History(discretization.s, new_set, history.lost + lost,
                   *left_by_contacts(system, state, gripper, history), left_by_hold(system),
                   positions, state.rotations[:, :, 0].copy(), discretization.surroundings)
    converged = bool(_promised(system, state, found.residual, rounding)
                     and stability > -_neutral(discretization, system)
                     and _kept(discretization, gripper, system, state, found.violation, far_end))
    return Shape(gripper, discretization.s, positions, state.rotations, state.strains, energy,
                 elastic, _wrench(discretization, state), float(found.residual),
                 float(stability), int(found.iterations), converged, contacts=touching,
                 evaluations=found.evaluations, violation=float(found.violation), far_end=far_end,
                 far_wrench=_NOTHING if far_end is None else _far_wrench(state),
                 dissipated=past.lost,
                 _estimate=partial(_estimate, discretization, gripper, state.strains,
                                   state.positions, history, far_end),
                 _discretization=discretization, _history=past, _before=history)


def _neutral(discretization, system):
    """Return below what eigenvalue, negated, a shape is not stable any more."""
    constrained = (obstructed(system.contact) or holds(system.hold)
                   or discretization.surroundings.pinned)
    return HELD_NEUTRAL if constrained else NEUTRAL


def _promised(system, state, residual, rounding):
    """Whether the residual is below what is promised, or where constrained, what rounding leaves.

    Forces that rounding errors hide, of a DLO that is nearly taut, are no answer.
    """
    if not obstructed(system.contact) and not holds(system.hold):
        return residual < CONVERGED + 100 * rounding
    noise = gradient_noise(system, state)
    promised = _TOUCHING if obstructed(system.contact) else CONVERGED
    return residual < max(promised, noise) + 100 * rounding and noise < _BLURRED


def _kept(discretization, gripper, system, state, violation, far_end):
    """Whether no constraint is violated by more than counts."""
    length = discretization.s[-1]
    if far_end is not None:
        # the slack of a DLO that is nearly taut decides on its tension
        slack = length - distance(far_end, gripper)
        missed = hold_violation(system.hold, state.rotations[-1].copy(), state.positions[-1].copy())
        most = min(_HELD * length, _SLACK * slack) if discretization.loaded else _HELD * length
        if (not within_reach(far_end, gripper, length, discretization.loaded)
                or missed > most):
            return False
    return violation <= KEPT * length


def elastic_energy(discretization, strains, plastic_set):
    """Return the stored energy in J of element strains (N, 3) with a set (N, J)."""
    system = discretization.static
    if not discretization.yields:
        bent = strains - system.natural
        return 0.5 * float(np.sum(system.lengths[:, None] * system.stiffness * bent**2))
    layers, strains = system.plastic._replace(set=plastic_set.copy()), strains.copy()
    return (stored(system.effects, system, strains)
            + add_plastic(system.lengths, strains, system.natural, layers, np.zeros_like(strains)))


_NOTHING = np.zeros(6)


def _wrench(discretization, state):
    """Return force and moment (6,) on the DLO at its gripper."""
    moment = state.base_moment
    if discretization.surroundings.has_moments:
        moment = moment - discretization.moments.sum(axis=0)
    return np.concatenate([state.base_force, moment])


def _far_wrench(state):
    """Return force and moment (6,) on the DLO at its far end, about that end."""
    return -tip_wrench(state)


def _estimate(discretization, gripper, strains, positions, history, far_end):
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.
    """
    finer = discretization.finer
    past = finer.past(history)
    system = finer.system(gripper.rotation, gripper.position, past, far_end)
    q = np.empty((finer.n_unknowns, 3))
    unknowns_of(system, np.repeat(strains, 2, axis=0), q)
    if (discretization.obstructed or far_end is not None or discretization.yields
            or discretization.surroundings.has_moments or discretization.surroundings.pinned):
        found = solve(finer, system, gripper, q, past)
        state, system = found.state, found.system
        if not (_promised(system, state, found.residual, 0.0)
                and found.stability > -_neutral(finer, system)
                and _kept(finer, gripper, system, state, found.violation, far_end)):
            return np.inf
    else:
        state = newton(system, q, 1e-9, 4, False).state
    moved = np.linalg.norm(state.positions[::2] - positions, axis=1).max()
    if discretization.obstructed and moved > _ELSEWHERE * discretization.s[-1]:
        return np.inf
    rounding = 1e-15 * discretization.s.size * discretization.s[-1]
    return float(4 / 3 * moved + rounding)
