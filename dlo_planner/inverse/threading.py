"""Threading through one cut-out: at every depth the DLO passes the centre along the normal."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.continuation import shape_change
from dlo_planner.direct.statics import TOLERANCE, equilibrium, shape_of
from dlo_planner.energy.potential import evaluate, new_state, unknowns_of
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.aligned import aligned_newton, free_axis
from dlo_planner.inverse.marching import march_from_end
from dlo_planner.inverse.nested import nested_alignment
from dlo_planner.inverse.plan import Plan, PlanStatus
from dlo_planner.inverse.timing import times_at_speed
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.pose import Pose

_MAX_ITERATIONS = 60
_LONGEST_STEP = 1 / 16   # of the length: depth steps of the continuation
_SHORTEST_STEP = 1 / 4096
_RECOVERIES = 12
_LEAP = 1.0              # rad: a change of shape between waypoints that is no continuation


def thread(simulator, cutout, depths, roll, method, speeds, progress):
    """Return the Plan; see `InverseSimulator.thread` for what the arguments mean.

    The shape is continued from depth 0, where the free end alone is prescribed, through all
    depths; between waypoints in steps short enough to stay on one branch.
    """
    length = simulator.rod.length
    grippers, shapes, misaligned, missed = [], [], [], []
    align = {'coupled': _coupled, 'nested': _nested}[method]

    def plan(status):
        reached = len(grippers)
        return Plan(np.array(depths[:reached]), grippers, shapes, np.array(misaligned),
                    np.array(missed), times_at_speed(grippers, *speeds), reached / len(depths),
                    status)

    shape, reference = _first(simulator, cutout, roll)
    depth = 0.0
    for index, wanted in enumerate(depths):
        step = _LONGEST_STEP * length
        found = None
        while True:
            target = min(wanted, depth + step)
            # Steps between waypoints are guesses only, so the quick method makes them all.
            way = align if target == wanted else _coupled
            found = way(simulator, shape, length - target, cutout.normal, reference)
            if found is not None:
                shape, depth = found, target
                if depth == wanted:
                    break
            elif step > _SHORTEST_STEP * length and target > depth:
                step /= 2
            else:
                found = recover(simulator, shape, length - wanted, cutout.normal, reference)
                if found is None or shapes and shape_change(shapes[-1], found) > _LEAP:
                    raise Infeasible(
                        f'waypoint {index} (depth {wanted:g} m): no equilibrium with the tangent '
                        f'along the normal was found beyond depth {depth:g} m', index,
                        'equilibrium', wanted - depth, plan(PlanStatus.PARTIAL))
                shape, depth = found, wanted
                break
        if shape.stability < -NEUTRAL:
            stable = recover(simulator, shape, length - wanted, cutout.normal, reference)
            if stable is not None and shapes and shape_change(shapes[-1], stable) > _LEAP:
                stable = None  # it exists, but the DLO would have to leap there
            if stable is None:
                raise Infeasible(
                    f'waypoint {index} (depth {wanted:g} m): the DLO would not stay in the shape '
                    f'that passes the cut-out; stability {shape.stability:.3g} < 0', index,
                    'stability', -shape.stability, plan(PlanStatus.PARTIAL))
            shape = stable
        pierced = shape.at(length - wanted)
        placed = shape.moved(cutout.centre - pierced.position)
        grippers.append(placed.gripper)
        shapes.append(placed)
        pierced = placed.at(length - wanted)
        misaligned.append(_angle(pierced.direction, cutout.normal))
        missed.append(float(np.linalg.norm(pierced.position - cutout.centre)))
        reference = placed.gripper.rotation
        if progress is not None:
            progress(index + 1, len(depths))
    return plan(PlanStatus.COMPLETE)


def _angle(one, other):
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _first(simulator, cutout, roll):
    """Return a Shape whose free end points along the normal, and the roll reference."""
    upright = Pose.looking_along((0.0, 0.0, 0.0), cutout.normal).rotation
    if roll is not None:
        upright = _least_turn(roll.direction, cutout.normal) @ roll.rotation
    discretisation = simulator.discretisation(Pose.from_rotation((0, 0, 0), upright), None)
    strains, base = march_from_end(discretisation.system(upright), np.array(upright, order='C'))
    shape = _shape_at(discretisation, strains, base)
    # The end's roll was a guess: give the gripper the roll of the reference instead.
    return shape, _least_turn(upright[:, 0], base[:, 0]) @ upright


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
    return shape_of(discretisation, gripper, system, state, np.inf, -np.inf, 0)


def _coupled(simulator, guess, s, normal, reference):
    """Return the aligned Shape by `aligned_newton`, or None."""
    discretisation = guess._discretisation
    for _ in range(6):
        shape = _coupled_on(discretisation, guess, s, normal, reference)
        if shape is None:
            return None
        better = simulator.discretisation(shape.gripper, shape)
        if better is discretisation:
            return shape
        discretisation, guess = better, shape
    return shape


def _coupled_on(discretisation, guess, s, normal, reference):
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
    return shape_of(discretisation, gripper, system, state, residual, stability, iterations)


def _nested(simulator, guess, s, normal, reference):
    """Return the aligned Shape by the paper's nested minimisation, or None."""
    shape = nested_alignment(simulator, guess, s, normal, reference)
    aligned = _angle(shape.at(s).direction, normal) < 1e-8
    return shape if shape.converged and aligned else None


def recover(simulator, shape, s, normal, reference):
    """Look for a stable aligned Shape near an unstable one; None if there is none to be found.

    Lets the DLO fall into its minimum, turns the gripper so that the tangent fits again, and
    repeats that; what comes out is only believed if it is aligned, stable and in equilibrium.
    """
    for _ in range(_RECOVERIES):
        fallen, _ = equilibrium(shape._discretisation, shape.gripper, shape.element_strains)
        if not fallen.converged:
            return None
        found = _coupled(simulator, fallen, s, normal, reference)
        if found is not None and found.stability > -NEUTRAL:
            return found
        turn = _least_turn(fallen.at(s).direction, normal)
        shape = replace(fallen, gripper=Pose.from_rotation((0.0, 0.0, 0.0),
                                                           turn @ fallen.gripper.rotation))
    return None
