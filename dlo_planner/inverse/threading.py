"""Threading through one cut-out: at every depth the DLO passes the centre along the normal."""

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from dlo_planner.direct.continuation import shape_change
from dlo_planner.direct.statics import TOLERANCE, equilibrium, shape_of
from dlo_planner.energy.potential import evaluate, new_state, unknowns_of
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.aligned import aligned_newton, free_axis
from dlo_planner.inverse.clearance import sheet_of
from dlo_planner.inverse.draft import Draft
from dlo_planner.inverse.marching import march_from_end
from dlo_planner.inverse.nested import nested_alignment
from dlo_planner.inverse.plan import PlanStatus, first_part, waypoint_of
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.pose import Pose

_MAX_ITERATIONS = 60
_LONGEST_STEP = 1 / 16   # of the length: depth steps of the continuation
_SHORTEST_STEP = 1 / 1024
_RECOVERIES = 6
_ROLLS = 24              # of the free end, tried for the start
_LEAP = 1.0              # rad: a change of shape between waypoints that is no continuation


def thread(simulator, cutout, depths, start, method, brief):
    """Return the Plan; see `InverseSimulator.thread` for what the arguments mean.

    Which roll of the DLO the threading begins with is free. If the plan that begins with the
    first choice is refused, others are tried, unless all rolls are alike (round and straight).
    """
    refused = None
    for first, reference in _starts(simulator, cutout, start):
        try:
            # Recovering is slow and seldom helps: done for the first choice only.
            return _thread_from(first, reference, simulator, cutout, depths, method, brief,
                                _RECOVERIES if refused is None else 0)
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    raise refused


def kept_before(plan, cutout, wanted, may_end):
    """Return the part of a Plan in which the gripper is `wanted` m before the sheet.

    Args:
        may_end: whether the plan may end earlier than it does

    Raises:
        Infeasible: it may not, or the first waypoint is too near already
    """
    rooms = np.array([(cutout.centre - gripper.position) @ cutout.normal
                      for gripper in plan.grippers])
    if (rooms >= wanted).all():
        return plan
    index = int(np.argmax(rooms < wanted))
    if may_end and index:
        return first_part(plan, index, PlanStatus.COMPLETE)
    raise Infeasible(f'waypoint {index} (depth {plan.depths[index]:g} m): the gripper is '
                     f'{rooms[index]:.3g} m before the sheet, gripper_clearance = {wanted:g} m',
                     index, 'gripper_clearance', float(wanted - rooms[index]),
                     first_part(plan, index, PlanStatus.PARTIAL))


def _thread_from(shape, reference, simulator, cutout, depths, method, brief, recoveries):
    """Continue `shape` from depth 0, where the free end alone is prescribed, through all depths.

    Between waypoints in steps short enough to stay on one branch.
    """
    length = simulator.rod.length
    draft = Draft(depths, brief)
    sheet = sheet_of(cutout, length, brief.obstacles)
    align = {'coupled': aligned_shape, 'nested': _nested}[method]
    depth = 0.0
    for wanted in depths:
        shape, depth = _reach(simulator, shape, depth, wanted, align, cutout.normal, reference,
                              recoveries)
        if shape is None:
            raise draft.refusal('equilibrium', wanted - depth, 'no equilibrium with the tangent '
                                f'along the normal was found beyond depth {depth:g} m')
        if shape.stability < -NEUTRAL:
            stable = _recovered(simulator, shape, length - wanted, cutout.normal, reference,
                                recoveries)
            if stable is None or draft.last is not None and _leaps(draft.last, stable):
                raise draft.refusal('stability', -shape.stability, 'the DLO would not stay in the '
                                    'shape that passes the cut-out; stability '
                                    f'{shape.stability:.3g} < 0')
            shape = stable
        elif draft.last is not None and _leaps(draft.last, shape):
            raise draft.refusal('equilibrium', shape_change(draft.last, shape), 'the DLO would '
                                'have to leap into another shape; closer waypoints may help')
        draft.add(waypoint_of(shape, cutout.centre, length - wanted, cutout.normal).inside(
            [cutout], [sheet], brief.radius))
        reference = shape.gripper.rotation
    return draft.finished()


def _reach(simulator, shape, depth, wanted, align, normal, reference, recoveries):
    """Return the aligned Shape at depth `wanted` and that depth; None and how far it came."""
    length = simulator.rod.length
    step = _LONGEST_STEP * length
    while True:
        target = min(wanted, depth + step)
        # Steps between waypoints are guesses only, so the quick method makes them all.
        way = align if target == wanted else aligned_shape
        found = way(simulator, shape, length - target, normal, reference)
        if found is not None:
            shape, depth = found, target
            if depth == wanted:
                return shape, depth
        elif step > _SHORTEST_STEP * length and target > depth:
            step /= 2
        else:
            found = _recovered(simulator, shape, length - wanted, normal, reference, recoveries)
            return (found, wanted) if found is not None else (None, depth)


def _leaps(one, other):
    """Whether the shape changes more from one waypoint to the next than continuity allows."""
    return shape_change(one, other) > _LEAP


def _angle(one, other):
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _starts(simulator, cutout, start):
    """Yield Shapes whose free end points along the normal, and the reference for their roll.

    The free end's roll about the normal is a choice. The first one is made so that the gripper is
    not rolled: seen along its own axis it stands as `start` does (or upright, without one). A
    curved DLO may have several such rolls; the one that turns the gripper least comes first. All
    others follow in steps, unless the DLO is round and straight and one roll is like another.
    """
    upright = Pose.looking_along((0.0, 0.0, 0.0), cutout.normal).rotation
    wanted = upright
    if start is not None:
        wanted = _least_turn(start.direction, cutout.normal) @ start.rotation
    discretisation = simulator.discretisation(Pose.from_rotation((0, 0, 0), upright), None)
    system = discretisation.system(upright)

    def end_rolled(angle):
        """Return strains, gripper rotation, its reference and its roll against that, rad."""
        turn = Rotation.from_rotvec(angle * cutout.normal).as_matrix()
        strains, base = march_from_end(system, turn @ wanted)
        reference = _least_turn(wanted[:, 0], base[:, 0]) @ wanted
        across = reference.T @ base[:, 1]
        return strains, base, reference, np.arctan2(across[2], across[1])

    def roll(angle):
        return end_rolled(angle)[3]

    def turn_against_start(angle):
        return Rotation.from_matrix(end_rolled(angle)[1] @ wanted.T).magnitude()

    angles = np.linspace(-np.pi, np.pi, _ROLLS + 1)
    rolls = [roll(angle) for angle in angles]
    roots = [brentq(roll, angles[k], angles[k + 1], xtol=1e-12) for k in range(_ROLLS)
             if rolls[k] * rolls[k + 1] <= 0 and abs(rolls[k] - rolls[k + 1]) < np.pi]
    for root in sorted(roots, key=turn_against_start):
        strains, base, reference, _ = end_rolled(root)
        yield _shape_at(discretisation, strains, base), reference
    if not roots or not _rolls_are_alike(simulator.rod, discretisation):
        for angle in sorted(angles[:-1:2], key=turn_against_start):
            strains, base, _, _ = end_rolled(angle)
            yield _shape_at(discretisation, strains, base), base


def _rolls_are_alike(rod, discretisation):
    return rod.bending_stiffness[0] == rod.bending_stiffness[1] and not np.any(
        discretisation.natural)


def _least_turn(one, other):
    """Return the rotation (3, 3) about the axis across both that takes unit vector one to other."""
    return Rotation.from_rotvec(_rotvec_between(one, other)).as_matrix()


def _rotvec_between(one, other):
    axis = np.cross(one, other)
    sine = np.linalg.norm(axis)
    if sine < 1e-12:
        if one @ other > 0:
            return np.zeros(3)
        helper = np.eye(3)[np.argmin(np.abs(one))]  # opposite: any axis across will do
        axis = np.cross(one, helper)
        sine = np.linalg.norm(axis)
        return axis / sine * np.pi
    return axis / sine * np.arctan2(sine, one @ other)


def _shape_at(discretisation, strains, base):
    """Return a Shape with these strains, whether in equilibrium or not (a guess)."""
    gripper = Pose.from_rotation((0.0, 0.0, 0.0), base)
    system = discretisation.system(base)
    state = new_state(system)
    unknowns_of(system, strains, state.q)
    evaluate(system, state)
    return shape_of(discretisation, gripper, (state, np.inf, -np.inf, 0, 0, system, 0.0))


def aligned_shape(simulator, guess, s, normal, reference):
    """Return the Shape whose tangent at `s` is `normal`, by `aligned_newton`, or None.

    Args:
        guess: Shape; reference: (3, 3) gripper rotation since which it does not turn freely
    """
    discretisation = guess._discretisation
    for _ in range(6):
        shape = _aligned_on(discretisation, guess, s, normal, reference)
        if shape is None:
            return None
        better = simulator.discretisation(shape.gripper, shape)
        if better is discretisation:
            return shape
        discretisation, guess = better, shape
    return shape


def _aligned_on(discretisation, guess, s, normal, reference):
    system = discretisation.system(guess.gripper.rotation)
    q = np.empty((discretisation.n_unknowns, 3))
    unknowns_of(system, discretisation.strains_from(guess.s, guess.element_strains), q)
    element = min(int(np.searchsorted(discretisation.s, s, side='right')) - 1,
                  discretisation.s.size - 2)
    fraction = (s - discretisation.s[element]) / system.lengths[element]
    state, base, residual, _, stability, iterations, converged = aligned_newton(
        system, q, element, fraction, np.array(normal), np.array(reference, order='C'),
        free_axis(reference, normal), TOLERANCE, _MAX_ITERATIONS)
    if not converged:
        return None
    gripper = Pose.from_rotation((0.0, 0.0, 0.0), base)
    return shape_of(discretisation, gripper,
                    (state, residual, stability, iterations, 0, system, 0.0))


def _nested(simulator, guess, s, normal, reference):
    """Return the aligned Shape by the paper's nested minimisation, or None."""
    shape = nested_alignment(simulator, guess, s, normal, reference)
    aligned = _angle(shape.at(s).direction, normal) < 1e-8
    return shape if shape.converged and aligned else None


def _recovered(simulator, shape, s, normal, reference, recoveries):
    """Look for a stable aligned Shape near an unstable one; None if there is none to be found.

    Lets the DLO fall into its minimum, turns the gripper so that the tangent fits again, and
    repeats that; what comes out is only believed if it is aligned, stable and in equilibrium.
    """
    for _ in range(recoveries):
        fallen, _ = equilibrium(shape._discretisation, shape.gripper, shape.element_strains)
        if not fallen.converged:
            return None
        found = aligned_shape(simulator, fallen, s, normal, reference)
        if found is not None and found.stability > -NEUTRAL:
            return found
        turn = _least_turn(fallen.at(s).direction, normal)
        shape = replace(fallen, gripper=Pose.from_rotation((0.0, 0.0, 0.0),
                                                           turn @ fallen.gripper.rotation))
    return None
