"""Threading through two cut-outs: their centres without orientation (paper, section 5.2, Fig. 14).

Until the free end reaches the second cut-out, the DLO passes the first one along one direction;
from then on it passes both centres at once. The direction is the one it has at the moment of the
change, so that the gripper's way is continuous. As gravity does not notice where the gripper is,
its rotation and one arc length are solved for, x(s2) - x(s1) = P2 - P1, and it is displaced after.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.continuation import shape_change
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.aligned import free_axis
from dlo_planner.inverse.beginnings import rolls_are_alike
from dlo_planner.inverse.clearance import sheet_of
from dlo_planner.inverse.continuity import refusal_for_leap
from dlo_planner.inverse.draft import Brief, Draft
from dlo_planner.inverse.plan import waypoint_of
from dlo_planner.inverse.threading import aligned_shape, thread
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.ritz.arc import rotation_and_chord

_ITERATIONS = 30
_EXACT = 1e-10          # of the length
_CHORD = 1e-5           # of the length
_LARGEST_TURN = 0.3     # rad per step
_LONGEST_STEP = 1 / 20  # of the length: depth steps of the continuation
_SHORTEST_STEP = 1 / 2000
_LEAP = 1.0             # rad: a change of shape between waypoints that is no continuation
_GUESSES = 9
_ROLLS = 6               # with which it may begin


def thread_two(simulator, first, second, depths, start, brief):
    """Return the Plan; see `InverseSimulator.thread_two` for what the arguments mean."""
    way = second.centre - first.centre
    length, apart = simulator.rod.length, float(np.linalg.norm(way))
    if apart < 1e-6 * length:
        raise InvalidTask('second: expected another centre than the first cut-out\'s')
    refused = None
    for begin in _rolled(simulator, way, start):
        try:
            return _thread_from(simulator, first, second, depths, begin, brief)
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    raise refused


def _rolled(simulator, way, start):
    """Yield Poses, or None, against whose roll the DLO is turned least: first as it is wanted."""
    yield start
    if rolls_are_alike(simulator):
        return
    upright = Pose.looking_along((0.0, 0.0, 0.0), way) if start is None else start
    for k in range(1, _ROLLS):
        turn = Rotation.from_rotvec(2 * np.pi * k / _ROLLS * upright.direction).as_matrix()
        yield Pose.from_rotation(upright.position, turn @ upright.rotation)


def _thread_from(simulator, first, second, depths, start, brief):
    """Return the Plan that begins with the roll of `start`, a Pose or None."""
    way = second.centre - first.centre
    length, apart = simulator.rod.length, float(np.linalg.norm(way))
    shape, reached = _change_over(simulator, first, way, apart, start)
    if shape is None:
        raise Infeasible(f'no stable shape passes both centres, {apart:g} m apart, as the free end '
                         'reaches the second one', int(np.searchsorted(depths, apart)), 'reach',
                         reached, Draft(depths, brief).partial())
    direction = shape.at(length - reached).direction
    before = [depth for depth in depths if depth < reached]
    found = [None] * len(depths)
    current, at = shape, reached
    for index in reversed(range(len(before))):
        current, at = _follow(current, at, depths[index], _one(simulator, direction), length)
        found[index] = (current, length - depths[index], None)
        if not _good(current):
            break
    current, at, s2 = shape, reached, length
    for index in range(len(before), len(depths)):
        step = _both(simulator, way, [s2])
        current, at = _follow(current, at, depths[index], step, length)
        s2 = step.s2[0]
        found[index] = (current, length - depths[index], s2)
        if not _good(current):
            break
    return _judged(simulator, found, first, second, depths, brief)


def _judged(simulator, found, first, second, depths, brief):
    """Return the Plan of all waypoints, or raise Infeasible at the first that is not to be had."""
    length, draft = simulator.rod.length, Draft(depths, brief)
    sheets = [sheet_of(cutout, length, brief.obstacles) for cutout in (first, second)]
    for one in found:
        shape = one[0] if one is not None else None
        if not _good(shape):
            if shape is not None and shape.stability < -NEUTRAL:
                raise draft.refusal('stability', -shape.stability, 'the DLO would not stay there; '
                                    f'stability {shape.stability:.3g} < 0')
            raise draft.refusal('equilibrium', depths[len(draft.waypoints)],
                                'no equilibrium passes the centres')
        refusal = refusal_for_leap(simulator, draft, shape)
        if refusal is not None:
            raise refusal
        waypoint = waypoint_of(shape, first.centre, one[1], None)
        if one[2] is not None:
            waypoint = waypoint.also(second.centre, one[2])
        draft.add(waypoint.inside([first, second], sheets, brief.radius))
    return draft.finished()


def _good(shape):
    return shape is not None and shape.converged


def _change_over(simulator, first, way, apart, start):
    """Return the Shape whose free end is at the second centre, and its depth in the first."""
    length = simulator.rod.length
    along = CutOut(Pose.looking_along(first.centre, way))
    for share in np.linspace(1.0, 1.4, _GUESSES):
        depth = share * apart
        if depth >= length:
            break
        try:
            plan = thread(simulator, along, np.linspace(0, depth, 6), start, None, 'coupled',
                          Brief((1.0, 1.0)))
        except Infeasible:
            continue
        guess = plan.shapes[-1]
        found = _two_points(simulator, guess, way, length - depth, length, 'first')
        if found is not None and found[0].converged:
            return found[0], length - found[1]
    return None, apart


def _follow(shape, depth, wanted, solve, length):
    """Continue from one depth to another in short steps; return the last Shape and depth."""
    step = _LONGEST_STEP * length
    while depth != wanted:
        target = depth + np.clip(wanted - depth, -step, step)
        found = solve(shape, length - target)
        if found is not None and shape_change(shape, found) < _LEAP:
            shape, depth = found, target
        elif step > _SHORTEST_STEP * length:
            step /= 2
        else:
            return found, depth
    return shape, depth


def _one(simulator, direction):
    """Return a function (shape, s1) -> Shape with its tangent at s1 along `direction`, or None."""
    def solve(shape, s1):
        return aligned_shape(simulator, shape, s1, direction, shape.gripper.rotation)
    return solve


def _both(simulator, way, s2):
    """Return a function (shape, s1) -> Shape through both centres; its list s2 has the other s."""
    def solve(shape, s1):
        found = _two_points(simulator, shape, way, s1, solve.s2[0], 'second')
        if found is None:
            return None
        solve.s2[0] = found[2]
        return found[0]
    solve.s2 = s2
    return solve


def _two_points(simulator, shape, way, s1, s2, free):
    """Find the gripper's rotation and an arc length such that x(s2) - x(s1) = `way`.

    Newton's method with the sensitivities of the equilibrium. The rotation that is left free, about
    the line between the points, is not made.

    Args:
        free: 'first' or 'second': which of s1 and s2 is sought

    Returns:
        Shape, s1, s2; None if there is none
    """
    length = shape.s[-1]
    axis = free_axis(shape.gripper.rotation, way / np.linalg.norm(way))
    rows, turned = None, 0.0
    turn, chord = np.empty((3, 3)), np.empty(3)
    for _ in range(_ITERATIONS):
        (one, begin), (other, end) = shape.frame_at(s1), shape.frame_at(s2)
        miss = end - begin - way
        size = np.linalg.norm(miss)
        if size < _EXACT * length and abs(turned) < 1e-9:
            return shape, s1, s2
        if rows is None or size > _CHORD * length:  # so near, the last derivatives will do
            answer = Sensitivity(shape)
            rows = np.zeros((4, 4))
            rows[:3, :3] = answer.at(s2)[3:, :3] - answer.at(s1)[3:, :3]
            rows[:3, 3] = -one[:, 0] if free == 'first' else other[:, 0]
            rows[3, :3] = axis
        try:
            step = np.linalg.solve(rows, np.append(-miss, -turned))
        except np.linalg.LinAlgError:
            return None
        step *= min(1.0, _LARGEST_TURN / max(np.linalg.norm(step[:3]), 1e-300),
                    0.1 * length / max(abs(step[3]), 1e-300))
        rotation_and_chord(step[0], step[1], step[2], 1.0, turn, chord)
        turned += axis @ step[:3]
        if free == 'first':
            s1 = s1 + step[3]
        else:
            s2 = s2 + step[3]
        if not (0 <= s1 < s2 <= length * (1 + 1e-12)):
            return None
        s2 = min(s2, length)
        gripper = Pose.from_rotation(shape.gripper.position, turn @ shape.gripper.rotation)
        shape = simulator.solve(gripper, shape)
        if not shape.converged:
            return None
    return None
