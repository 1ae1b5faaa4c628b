"""Threading through one cut-out: at every depth the DLO passes the centre along the normal."""

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.statics import TOLERANCE, shape_of
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.aligned import aligned_newton, free_axis
from dlo_planner.inverse.beginnings import beginnings, rolls_are_alike
from dlo_planner.inverse.clearance import sheet_of
from dlo_planner.inverse.continuity import refusal_for_leap
from dlo_planner.inverse.draft import Draft
from dlo_planner.inverse.nested import nested_alignment
from dlo_planner.inverse.plan import PlanStatus, first_part, waypoint_of
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.pose import Pose

_MAX_ITERATIONS = 60
_LONGEST_STEP = 1 / 16   # of the length: depth steps of the continuation
_SHORTEST_STEP = 1 / 1024
_ROLLS = (0.1, -0.1, 0.2, -0.2, 0.35, -0.35, 0.5, -0.5)  # rad, tried between two waypoints
_DOUBTFUL = 0.05  # stability below which another roll is looked for


def thread(simulator, cutout, depths, start, initial, method, brief):
    """Return the Plan; see `InverseSimulator.thread` for what the arguments mean.

    Which roll of the DLO the threading begins with is free. If the plan that begins with the
    first choice is refused, others are tried, unless all rolls are alike (round and straight).
    """
    refused = None
    for first, reference in beginnings(simulator, cutout, start):
        try:
            return _thread_from(first, reference, simulator, cutout, depths, initial, method, brief)
        except Infeasible as error:
            if refused is None or _says_more(error, refused):
                refused = error
    raise refused


def _says_more(one, other):
    """Whether one Infeasible got farther than another, or got as far with a stable shape."""
    return (one.waypoint, one.constraint == 'start') > (other.waypoint,
                                                        other.constraint == 'start')


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


def _thread_from(shape, reference, simulator, cutout, depths, initial, method, brief):
    """Continue `shape` from depth 0, where the free end alone is prescribed, through all depths.

    Between waypoints in steps short enough to stay on one branch.
    """
    length, normal = simulator.rod.length, cutout.normal
    draft = Draft(depths, brief, initial=initial)
    sheet = sheet_of(cutout, length, brief.obstacles)
    align = {'coupled': aligned_shape, 'nested': _nested}[method]
    alike = rolls_are_alike(simulator)
    depth = 0.0
    for wanted in depths:
        found, depth = _reach(simulator, shape, depth, wanted, align, normal, reference)
        refusal = _refusal(simulator, draft, found, wanted, depth)
        doubtful = refusal is not None or found.stability < _DOUBTFUL
        if doubtful and draft.waypoints and not alike:
            found = _rolled(simulator, draft, wanted, align, normal, reference,
                            found if refusal is None else None)
        elif refusal is not None:
            found = None
        if found is None:
            raise refusal
        shape, depth, reference = found, wanted, found.gripper.rotation
        draft.add(waypoint_of(shape, cutout.centre, length - wanted, normal).inside(
            [cutout], [sheet], brief.radius))
    return draft.finished()


def _refusal(simulator, draft, shape, wanted, depth):
    """Return why a Shape, or None, cannot be the next waypoint at the depth `wanted`, or None."""
    if shape is None:
        return draft.refusal('equilibrium', wanted - depth, 'no equilibrium with the tangent '
                             f'along the normal was found beyond depth {depth:g} m')
    if shape.stability < -NEUTRAL:
        return draft.refusal('stability', -shape.stability, 'the DLO would not stay in the shape '
                             f'that passes the cut-out; stability {shape.stability:.3g} < 0')
    return refusal_for_leap(simulator, draft, shape)


def _rolled(simulator, draft, wanted, align, normal, reference, best):
    """Return the most stable Shape that will do, the gripper rolled on the way to it, or `best`."""
    axis = free_axis(reference, normal)
    for angle in _ROLLS:
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        found = align(simulator, draft.last, simulator.rod.length - wanted, normal,
                      turn @ reference)
        if found is None or best is not None and found.stability <= best.stability:
            continue
        if _refusal(simulator, draft, found, wanted, wanted) is None:
            best = found
    return best


def _reach(simulator, shape, depth, wanted, align, normal, reference):
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
            return None, depth


def _angle(one, other):
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


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
