"""Threading through one cut-out: at every depth the DLO passes the centre along the normal."""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.continuation import shape_change
from dlo_planner.direct.statics import TOLERANCE, equilibrium, shape_of
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.aligned import aligned_newton, free_axis
from dlo_planner.inverse.beginnings import beginnings, least_turn
from dlo_planner.inverse.clearance import sheet_of
from dlo_planner.inverse.draft import Draft
from dlo_planner.inverse.nested import nested_alignment
from dlo_planner.inverse.plan import PlanStatus, first_part, waypoint_of
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.pose import Pose

_MAX_ITERATIONS = 60
_LONGEST_STEP = 1 / 16   # of the length: depth steps of the continuation
_SHORTEST_STEP = 1 / 1024
_RECOVERIES = 6
_LEAP = 1.0              # rad: a change of shape between waypoints that is no continuation


def thread(simulator, cutout, depths, start, method, brief):
    """Return the Plan; see `InverseSimulator.thread` for what the arguments mean.

    Which roll of the DLO the threading begins with is free. If the plan that begins with the
    first choice is refused, others are tried, unless all rolls are alike (round and straight).
    """
    refused = None
    for first, reference in beginnings(simulator, cutout, start):
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
        turn = least_turn(fallen.at(s).direction, normal)
        shape = replace(fallen, gripper=Pose.from_rotation((0.0, 0.0, 0.0),
                                                           turn @ fallen.gripper.rotation))
    return None
