# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a motion begins: what can be simulated; shape, mesh and velocities at time 0."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.one_step import past_of
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import Search, shape_of, solve
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, number, returned, vector
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose, angle_between

# At time 0: of the nodes, or a callable of s
Velocity: TypeAlias = ArrayLike | Callable[[float], ArrayLike]

_SAME_POSE = 1e-6    # of the length, and rad: poses nearer to each other are the same
_SAME = 1e-9         # of the length, of the energy: what differs by less is the same
_DEEP = 1e-3         # of the length: a DLO so far inside an obstacle is no state of a motion
_FINEST = 96         # elements at least, where an accuracy chooses the mesh
_TOLERANCE = 1e-3    # of the length
_DIFFERENT = 0.1     # of the velocities: what grips and inextensibility may change of them


def refuse_motion(around: Surroundings, strains: str) -> None:
    """Raise InvalidTask where motions in these Surroundings, or by such strains, have no solver."""
    if around.pinned:
        raise InvalidTask('grip = \'pinned\': expected a simulator whose gripper clamps the '
                          'DLO where motions are simulated')
    if strains != 'components':
        raise InvalidTask(f'strains = {strains!r}: expected a simulator with \'components\' '
                          'where motions are simulated')
    if around.has_moments:
        raise InvalidTask('point_loads: expected forces alone in a motion, dead moments have '
                          'no potential')


def motion_tolerance(tolerance: float | None, length: float) -> float:
    """Return the tolerance of a motion in m; infinity is one."""
    if tolerance is None:
        return _TOLERANCE * length
    endless = isinstance(tolerance, float) and tolerance == np.inf
    return tolerance if endless else number('tolerance', tolerance, minimum=1e-9 * length)


def last_of(motion: Shape | Motion | None,
            velocity: Velocity | None) -> tuple[Shape | None, Velocity | None]:
    """Return the last Shape of a Motion and the velocities there, unless others are given."""
    if not isinstance(motion, Motion):
        return motion, velocity
    if not len(motion):
        raise InvalidTask('initial: expected a Motion with instants, it has none')
    return motion.shapes[-1], motion.velocities[-1] if velocity is None else velocity


def moving_mesh(known: Discretization) -> Discretization:
    """Return a Discretization for motions, as fine as `known`, everywhere L / 96 or finer.

    A mesh that was graded for one shape has to serve all that come.
    """
    s = known.s
    parts = np.ceil(np.diff(s) * (_FINEST / s[-1]) - 1e-9).astype(int)
    if parts.max() <= 1:
        return known
    finer = np.concatenate([np.linspace(one, other, n, endpoint=False) for one, other, n in
                            zip(s, s[1:], parts, strict=False)] + [s[-1:]])
    return Discretization(known.surroundings, finer, known.basis, known.n_terms)


def first_shape(discretization: Discretization, gripper: Pose, far_end: FarEnd | None,
                initial: Shape, history: History | None) -> Shape:
    """Return the Shape at time 0: that of `initial`, on this mesh and in these surroundings.

    Parameters
    ----------
    far_end : FarEnd or None
        FarEnd at time 0, or None.
    history : History or None
        History that the DLO has if `initial` is not one of its shapes.

    Raises
    ------
    InvalidTask
        `initial` is held elsewhere than the motion begins, or lies in an obstacle.
    """
    length = discretization.s[-1]
    _meets('initial', 'gripper', 'grippers[0]', initial.gripper, gripper, length)
    if far_end is not None:
        end = initial.at(float(initial.s[-1]))
        _meets('initial', 'far end', 'far_ends[0]', end, _allowed(far_end, end), length)
    history = past_of(discretization, initial, history)
    system = discretization.system(gripper.rotation, gripper.position, history, far_end)
    q = discretization.unknowns(discretization.strains_from(initial.s, initial.element_strains))
    found = solve(discretization, system, gripper, q, history, Search(0, False))
    # nothing was solved yet that could have failed
    first = replace(shape_of(discretization, gripper, found, history, far_end), converged=True)
    if initial.state.mesh is discretization and _alike(first, initial):
        first = initial
    if first.converged and first.violation > _DEEP * length:
        raise InvalidTask(f'initial: expected a Shape outside of all obstacles, it is '
                          f'{first.violation:.3g} m inside one')
    return first


def _allowed(far_end: FarEnd, end: Pose) -> Pose:
    """Return the Pose nearest to that of an `end` which the grip of a FarEnd allows."""
    place, pose = _held(far_end, end.position), far_end.pose
    if far_end.grip == 'pinned':
        return replace(end, position=place)
    if far_end.grip == 'aligned':  # free to turn about its tangent: that of `end`, tilted
        axis = np.cross(end.direction, pose.direction)
        sine = np.linalg.norm(axis)
        tilt = axis * (np.arctan2(sine, end.direction @ pose.direction) / sine if sine else 0.0)
        turn = scipy.spatial.transform.Rotation.from_rotvec(tilt).as_matrix()
        return Pose.from_rotation(place, turn @ end.rotation)
    return replace(pose, position=place)


def _held(far_end: FarEnd, position: Floats) -> Floats:
    """Return the position (3,) nearest to `position` at which a FarEnd may be."""
    if far_end.grip != 'sleeve':
        return far_end.pose.position
    free = far_end.pose.direction
    return far_end.pose.position + free * (free @ (position - far_end.pose.position))


def _meets(name: str, what: str, where: str, pose: Pose, wanted: Pose, length: float) -> None:
    shift = np.linalg.norm(pose.position - wanted.position)
    turn = angle_between(pose.rotation, wanted.rotation)
    if shift > _SAME_POSE * length or turn > _SAME_POSE:
        raise InvalidTask(f'{name}: expected a Shape whose {what} is at {where}, where the '
                          f'motion begins; it is {shift:.3g} m away and {turn:.3g} rad turned')


def _alike(one: Shape, other: Shape) -> bool:
    """Whether two Shapes on one mesh are the same, and know the same energy."""
    away = np.abs(one.positions - other.positions).max()
    size = abs(one.energy) + one.elastic_energy
    return away <= _SAME * one.s[-1] and abs(one.energy - other.energy) <= _SAME * size


def nodes_velocity(velocity: Velocity | None, initial: Shape | None, first: Shape) -> Floats | None:
    """Return (N + 1, 3) m/s at the nodes of the Shape `first`, None for a DLO at rest.

    Parameters
    ----------
    velocity : array_like or callable or None
        (n + 1, 3) at the nodes of `initial`, a callable of s (m), or None.
    initial : Shape or None
        Shape. If None, its nodes are those of `first`.

    Raises
    ------
    InvalidTask
        It is something else.
    """
    if velocity is None:
        return None
    if callable(velocity):
        return np.array([vector(f'velocity({s:g})', returned('velocity', velocity, s), 3)
                         for s in first.s])
    s = first.s if initial is None else initial.s
    given = array('velocity', velocity, (s.size, 3))
    return np.column_stack([np.interp(first.s, s, one) for one in given.T])


def check_velocity(masses: Floats, wanted: Floats, possible: Floats) -> None:
    """Raise InvalidTask unless velocities (N + 1, 3) are nearly those that are possible.

    Parameters
    ----------
    masses : ndarray, shape (N + 1,)
        Masses of the nodes, kg.
    wanted, possible : ndarray, shape (N + 1, 3)
        Velocities, m/s.
    """
    size, change = (np.sqrt(masses @ np.sum(one**2, axis=1)) for one in (
        wanted, possible - wanted))
    if change > _DIFFERENT * size:
        raise InvalidTask(
            'velocity: expected one that the grips and a constant length allow; the nearest such '
            f'motion differs from it by {100 * change / size if size else np.inf:.3g} % '
            '(root mean square by mass)')
