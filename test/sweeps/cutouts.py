# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random cut-outs and bores: planned and replayed, or refused and the refusal confirmed."""

import numpy as np
from references.hanging import directions_in_first, no_start, no_way
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, Infeasible, InverseSimulator, Pose, Rod, replay
from sweeps import MASS, Outcome, random_rod, timed

DEEPEST, DEEPEST_OF_SEQUENCES = 0.95, 0.8  # m
BASES = 'local', 'chebyshev'
MESHES = ({'basis': 'local'}, {'basis': 'chebyshev'}, {'accuracy': 1e-5})
_HIT = 1e-6  # m
_GRIDS = 2500, 10000  # points: a coarse one shows starts that are only near what is asked for
_STEP = 0.11  # rad plus part of the length: more at once is a leap if closer depths do not help


def steps(plan, length=1.0):
    """Return turns (n - 1,) in rad and displacements of the gripper, of the length."""
    turns = [Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude()
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    places = np.array([gripper.position for gripper in plan.grippers])
    return np.array(turns), np.linalg.norm(np.diff(places, axis=0), axis=1) / length


def leaps(plan, length=1.0):
    """Return whether a step is larger than any that the depth explains."""
    turns, shifts = steps(plan, length)
    deeper = np.diff(plan.depths) / length
    return (turns > 0.06 + 11 * deeper).any() or (shifts > 0.03 + 3.5 * deeper).any()


# ---- one cut-out ----------------------------------------------------------------------------


def random_cutout(rng):
    return random_rod(rng), CutOut(Pose.looking_along(rng.normal(size=3), rng.normal(size=3)))


def threaded(rod, cutout, basis, number=20):
    """Return the Outcome: 'replayed', 'confirmed', or what is wrong.

    Args:
        number: of depths
    """
    direct = DirectSimulator(rod, basis=basis, n_elements=64)
    depths = np.linspace(0, DEEPEST, number)
    plan, seconds = timed(InverseSimulator(direct).thread, cutout, depths=depths)
    if isinstance(plan, Infeasible):
        what = ('confirmed' if confirmed(direct, cutout, depths, plan) else
                f'refused for nothing: {plan.constraint}: {plan}')
    else:
        what = 'leaps' if leaps(plan) else replayed(direct, cutout, plan)
    return Outcome(what, seconds)


def replayed(direct, cutout, plan):
    """Return 'replayed', or what is wrong when the gripper moves as planned."""
    for depth, shape in zip(plan.depths, direct.track(plan.grippers), strict=True):
        axes, position = shape.frame_at(1 - depth)
        if not shape.converged:
            return f'not converged: at depth {depth:g}'
        if np.linalg.norm(position - cutout.center) > _HIT:
            return f'misses: at depth {depth:g}'
        if np.linalg.norm(axes[:, 0] - cutout.normal) > _HIT:
            return f'oblique: at depth {depth:g}'
    return 'replayed'


def confirmed(direct, cutout, depths, error):
    """Whether there is no way to the waypoint, among all ways in which the DLO can hang."""
    gets_there = falls_into(direct)
    given = direct.rod, np.array([0, 0, -9.81 * MASS]), cutout.normal
    if error.waypoint == 0:
        return no_start(*given, gets_there)
    return no_way(*given, 1 - depths[:error.waypoint + 1], gets_there)


def falls_into(direct):
    """Return a function: whether the DLO, set down, falls into a shape with frames (n, 3, 3)."""
    def gets_there(frames):
        shape = direct.solve(Pose.from_rotation((0, 0, 0), frames[0]))
        return np.abs(shape.frames[-1] - frames[-1]).max() < 0.02

    return gets_there


def cutouts(number, seed, depths):
    """Yield the Outcomes of random cut-outs."""
    rng = np.random.default_rng(seed)
    for index in range(number):
        yield threaded(*random_cutout(rng), BASES[index % 2], depths)


# ---- two cut-outs ---------------------------------------------------------------------------


def random_pair(rng):
    """Return a Rod and two CutOuts, 0.1 to 0.5 m apart, that face along the way between them."""
    rod, first = random_cutout(rng)
    way = rng.normal(size=3)
    way *= rng.uniform(0.1, 0.5) / np.linalg.norm(way)
    return rod, *(CutOut(Pose.looking_along(center, way))
                  for center in (first.center, first.center + way))


def distance(shape, point):
    """Return how far the DLO is from a point, m: sampled, and ever closer where it is nearest."""
    s = np.linspace(0, shape.s[-1], 201)
    while s[1] - s[0] > 1e-9:
        best = np.argmin(np.linalg.norm(shape.positions_at(s) - point, axis=1))
        s = np.linspace(s[max(best - 1, 0)], s[min(best + 1, s.size - 1)], 21)
    return np.linalg.norm(shape.positions_at(s[10:11])[0] - point)


def threaded_two(rod, first, second, basis, number=20):
    """Return the Outcome: 'replayed', 'confirmed', or what is wrong."""
    direct, depths = DirectSimulator(rod, basis=basis), np.linspace(0, DEEPEST, number)
    plan, seconds = timed(InverseSimulator(direct).thread_two, first, second, depths=depths)
    if isinstance(plan, Infeasible):
        what = ('confirmed' if confirmed_two(direct, first, second, plan) else
                f'refused for nothing?: {plan.constraint}: {plan}; {plan.amount:.3g}')
    else:
        what = 'leaps' if leaps(plan) else replayed_two(direct, first, second, plan)
    return Outcome(what, seconds)


def confirmed_two(direct, first, second, error):
    """Whether no stable shape passes both, or the DLO begins with none that leads there.

    It begins along the direction in which it is to pass the first one.
    """
    given = direct.rod, np.array([0, 0, -9.81 * MASS])
    for grid in _GRIDS:
        directions = directions_in_first(*given, first, second, grid)
        if error.waypoint == 0:
            directions = [one for one in directions if not no_start(
                *given, one / np.linalg.norm(one), falls_into(direct))]
        if len(directions) == 0:
            return True
    return False


def replayed_two(direct, first, second, plan):
    """Return 'replayed', or what is wrong when the gripper moves as planned."""
    apart = np.linalg.norm(second.center - first.center)
    reached = False
    for depth, shape in zip(plan.depths, direct.track(plan.grippers), strict=True):
        if not shape.converged:
            return f'not converged: at depth {depth:g}'
        axes, position = shape.frame_at(1 - depth)
        if np.linalg.norm(position - first.center) > _HIT:
            return f'misses the first: at depth {depth:g}'
        if axes[:, 0] @ first.normal <= 0:
            return f'passes the first backwards: at depth {depth:g}'
        hit = depth > apart and distance(shape, second.center) < _HIT
        if reached and not hit:
            return f'leaves the second: at depth {depth:g}'
        reached = hit
    return 'replayed' if reached else 'never comes to the second'


def pairs(number, seed, depths):
    """Yield the Outcomes of random pairs."""
    rng = np.random.default_rng(seed)
    for index in range(number):
        yield threaded_two(*random_pair(rng), BASES[index % 2], depths)


# ---- three cut-outs -------------------------------------------------------------------------


def random_sequence(rng):
    """Return a Rod and three CutOuts, 0.25 m apart, that face along a way that bends a little."""
    rod, first = random_cutout(rng)
    centers, way = [first.center], first.normal
    for _ in range(2):
        way = way + 0.4 * rng.normal(size=3)
        way /= np.linalg.norm(way)
        centers.append(centers[-1] + 0.25 * way)
    return rod, [CutOut(Pose.looking_along(center, way)) for center in centers]


def threaded_sequence(rod, holes, basis, number=100):
    """Return the Outcome: 'replayed', 'confirmed', 'refused', or what is wrong."""
    direct, depths = DirectSimulator(rod, basis=basis), np.linspace(0, DEEPEST_OF_SEQUENCES, number)
    plan, seconds = timed(InverseSimulator(direct).thread_sequence, holes, depths=depths)
    if isinstance(plan, Infeasible):  # it begins as a threading through the first one does
        what = ('confirmed' if plan.waypoint == 0 and confirmed(direct, holes[0], depths, plan)
                else f'refused, {plan.constraint}: {plan}; {plan.amount:.3g}')
    else:
        what = 'leaps' if leaps(plan) else follows(direct, plan)
    return Outcome(what, seconds)


def follows(direct, plan):
    """Return 'replayed', or where the shapes are others when the gripper moves as planned."""
    for depth, planned, shape in zip(plan.depths, plan.shapes, direct.track(plan.grippers),
                                     strict=True):
        if not shape.converged:
            return f'not converged: at depth {depth:g}'
        samples = np.linspace(0, shape.s[-1], 33)
        off = np.abs(shape.positions_at(samples) - planned.positions_at(samples)).max()
        if off > _HIT:
            return f'not replayed: off by {off:.2g} m at depth {depth:g}'
    return 'replayed'


def sequences(number, seed, depths):
    """Yield the Outcomes of random sequences."""
    rng = np.random.default_rng(seed)
    for index in range(number):
        yield threaded_sequence(*random_sequence(rng), BASES[index % 2], depths)


# ---- bores ----------------------------------------------------------------------------------


def random_bore(rng):
    """Return a Rod and a bore; half of the rods have weights."""
    kind = rng.integers(4)
    stiffness = np.exp(rng.uniform(np.log(0.1), np.log(2), 2))
    if kind == 0:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 if kind >= 2 else np.zeros(2)
    weights = rng.random() < 0.5
    rod = Rod(1.0, MASS, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
              natural_curvature=tuple(bent), natural_twist=rng.normal() * 0.5 if kind == 3 else 0,
              tip_mass=rng.uniform(0, 0.05) if weights else 0.0,
              point_masses=((rng.uniform(0.3, 0.9), 0.02),) if weights and rng.random() < 0.5
              else ())
    direction = rng.normal(size=3)
    return rod, CutOut(Pose.looking_along(rng.normal(size=3), direction))


def largest_step(plan):
    """Return the largest turn plus displacement of the gripper between two waypoints, rad and m."""
    return np.sum(steps(plan), axis=0).max()


def leaps_at_any_depths(inverse, bore, plan, depths):
    """Return whether a step of a Plan stays as long with eight times the depths."""
    if largest_step(plan) < _STEP:
        return False
    finer = np.interp(np.arange(8 * (len(depths) - 1) + 1) / 8, np.arange(len(depths)), depths)
    return largest_step(inverse.insert(bore, depths=finer)) > max(_STEP, 0.3 * largest_step(plan))


def inserted(rod, bore, how):
    """Return the Outcome: 'inserted', 'refused', or what is wrong."""
    direct = DirectSimulator(rod, **how)
    inverse, depths = InverseSimulator(direct), np.linspace(0, 0.95, 12)
    plan, seconds = timed(inverse.insert, bore, depths=depths)
    if isinstance(plan, Infeasible):
        return Outcome(f'refused, {plan.constraint}: {plan}; {plan.amount:.3g}', seconds)
    if not np.isin(depths, plan.depths).all() or plan.stability.min() < -1e-3:
        return Outcome('incomplete', seconds)
    if leaps_at_any_depths(inverse, bore, plan, depths):
        return Outcome(f'leaps: {largest_step(plan):.3g}', seconds)
    report = replay(direct, plan)
    if not report.converged or report.position_error > 1e-5 or report.misalignment > 1e-5:
        return Outcome(f'not replayed: {report}', seconds)
    return Outcome('inserted', seconds)


def insertions(number, seed):
    """Yield the Outcomes of random bores."""
    rng = np.random.default_rng(seed)
    for index in range(number):
        yield inserted(*random_bore(rng), MESHES[index % 3])
