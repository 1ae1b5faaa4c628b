# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The kinematics of a group of joints: Pinocchio's model with all other joints fixed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dlo_planner.arm.pinocchio import pinocchio
from dlo_planner.arm.urdf import mimics, parsed
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown

_LINK, _FIXED = 'link ', 'fixed '  # before names of frames
_FREE_ANGLE = 2  # numbers of a joint that turns for ever: cosine and sine


@dataclass(frozen=True, eq=False)
class Chain:
    """Joints that move a link.

    Attributes
    ----------
    names : tuple of str
        Names of m joints; all arrays have this order.
    lower, upper, speeds : ndarray, shape (m,)
        Limits in rad or m, rad/s or m/s; infinite where there is none.
    turning : ndarray, shape (m,)
        Which are angles.
    carriers : tuple of str
        Names of other joints that move the link.
    full : object
        pinocchio.Model of the whole robot.
    others : list of int
        Indices of its joints that are fixed.
    named : object
        The same, no two frames of which have one name.
    standing : ndarray
        Configuration of the whole robot in which those are as they are fixed.
    model : object
        pinocchio.Model of the joints alone.
    frame : int
        Index of the link's frame in it.
    """

    names: tuple[str, ...]
    lower: Floats
    upper: Floats
    speeds: Floats
    turning: Floats
    carriers: tuple[str, ...]
    full: Any
    named: Any
    others: list[int]
    standing: Floats
    model: Any
    frame: int
    data: Any = field(init=False)
    free: Floats = field(init=False)
    columns: Floats = field(init=False)
    places: Floats = field(init=False)

    def __post_init__(self) -> None:
        ids = [self.model.getJointId(name) for name in self.names]
        free = np.array([self.model.joints[k].nq == _FREE_ANGLE for k in ids])
        for name, value in (('data', self.model.createData()), ('free', free),
                            ('columns', np.array([self.model.joints[k].idx_v for k in ids])),
                            ('places', np.array([self.model.joints[k].idx_q for k in ids]))):
            object.__setattr__(self, name, value)

    def configuration(self, positions: Floats) -> Floats:
        """Return Pinocchio's configuration for joint positions (m,)."""
        out = np.empty(self.model.nq)
        out[self.places] = np.where(self.free, np.cos(positions), positions)
        out[self.places[self.free] + 1] = np.sin(positions[self.free])
        return out

    def placement(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return the link's position (3,) and rotation (3, 3) in the root link."""
        pin = pinocchio()
        pin.forwardKinematics(self.model, self.data, self.configuration(positions))
        place = pin.updateFramePlacement(self.model, self.data, self.frame)
        return place.translation.copy(), place.rotation.copy()

    def off(self, positions: Floats, place: Floats, turn: Floats) -> tuple[Floats, Floats]:
        """Return by what the link is off a placement, and how it moves with the joints.

        Returns
        -------
        (ndarray, ndarray)
            (6,) displacement in m and rotation vector in rad that are left, root axes; (6, m)
            Jacobian, linear before angular, same axes.
        """
        pin = pinocchio()
        configuration = self.configuration(positions)
        jacobian = pin.computeFrameJacobian(self.model, self.data, configuration, self.frame,
                                            pin.LOCAL_WORLD_ALIGNED)[:, self.columns]
        here, axes = self.placement(positions)
        return np.concatenate([place - here, pin.log3(turn @ axes.T)]), jacobian

    def link(self, frame: int) -> str:
        """Return the name of the link with the index `frame` in the model."""
        return str(self.model.frames[frame].name.removeprefix(_LINK))

    @property
    def middle(self) -> Floats:
        """(m,) middles of the ranges; 0 where there is none."""
        with np.errstate(invalid='ignore'):
            return np.where(np.isfinite(self.upper - self.lower),
                            0.5 * (self.lower + self.upper), 0.0)


def chain_of(urdf: str, tool_link: str, joints: Sequence[str], fixed: Mapping[str, float]) -> Chain:
    """Return the Chain of a URDF's text; see `Arm` for the arguments.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """
    pin, root = pinocchio(), parsed('urdf', urdf)
    try:
        model = pin.buildModelFromXML(urdf)
    except Exception as error:  # Boost.Python: any may come
        raise InvalidTask(f'urdf = {shown(urdf)}: expected a robot; {error}') from None
    followers = mimics(root)
    if not model.existFrame(tool_link, pin.BODY):
        links = [frame.name for frame in model.frames if frame.type == pin.BODY]
        raise InvalidTask(f'tool_link = {tool_link!r}: expected a link of the URDF, one of '
                          f'{shown(links)}')
    frame = model.getFrameId(tool_link, pin.BODY)
    moving = [model.names[k] for k in model.supports[model.frames[frame].parentJoint] if k]
    names = joints or tuple(name for name in moving if name not in followers)
    _judge(model, names, moving, followers)
    others = [k for k in range(1, model.njoints) if model.names[k] not in names]
    standing = _standing(model, others, fixed, followers)
    named = _unambiguous(model)
    reduced = pin.buildReducedModel(named, others, standing)
    lower, upper, speeds = _limits(model, names)
    turning = np.array(['P' not in model.joints[model.getJointId(name)].shortname().removeprefix(
        'JointModel') for name in names])
    carriers = tuple(name for name in moving if name not in (*names, *followers))
    return Chain(tuple(names), lower, upper, speeds, turning, carriers, model, named, others,
                 standing, reduced, reduced.getFrameId(_LINK + tool_link, pin.BODY))


def _unambiguous(model: Any) -> Any:
    """Return a copy of a model whose links and fixed joints have names that joints have not.

    In a URDF a link and a joint may have the same name, with which Pinocchio cannot fix joints.
    """
    pin, other = pinocchio(), model.copy()
    prefixes = {pin.BODY: _LINK, pin.FIXED_JOINT: _FIXED}
    for frame in other.frames:
        frame.name = prefixes.get(frame.type, '') + frame.name
    return other


def _judge(model: Any, names: Sequence[str], moving: Sequence[str],
           followers: Mapping[str, tuple[str, float, float]]) -> None:
    """Raise InvalidTask unless the joints are known, move the link, and lead no other ones."""
    if not names:
        raise InvalidTask('joints = (): the tool_link does not move: expected a link beyond joints')
    for index, name in enumerate(names):
        if not model.existJointName(name):
            raise InvalidTask(f'joints[{index}] = {name!r}: expected a movable joint of the URDF, '
                              f'one of {shown(list(model.names)[1:])}')
        if name in names[:index]:
            raise InvalidTask(f'joints[{index}] = {name!r}: expected each joint once')
        if name not in moving:
            raise InvalidTask(f'joints[{index}] = {name!r}: expected one that moves the tool_link: '
                              f'{", ".join(moving)}')
        if model.joints[model.getJointId(name)].nv != 1:
            raise InvalidTask(f'joints[{index}] = {name!r}: expected a revolute, continuous or '
                              'prismatic joint')
        if name in followers:
            raise InvalidTask(f'joints[{index}] = {name!r} follows {followers[name][0]!r}: '
                              'expected a joint with a drive of its own')
    for name, (leader, *_) in followers.items():
        if leader in names:
            raise InvalidTask(f'joints: {leader!r} drives {name!r} too, which is not supported: '
                              'expected joints that drive no other ones')


def _standing(model: Any, others: Sequence[int], fixed: Mapping[str, float],
              followers: Mapping[str, tuple[str, float, float]]) -> Floats:
    """Return a configuration of the whole robot with its fixed joints where they stand."""
    pin = pinocchio()
    for name in fixed:
        if not model.existJointName(name):
            raise InvalidTask(f'fixed[{name!r}]: expected joints of the URDF, '
                              f'{shown(list(model.names)[1:])}')
    turned = np.zeros(model.nv)
    for k in others:
        name = model.names[k]
        value = _fixed_at(name, fixed, followers)
        if model.joints[k].nv == 1:
            turned[model.joints[k].idx_v] = value
        elif name in fixed:
            raise InvalidTask(f'fixed[{name!r}] = {value:g}: expected a joint with one coordinate')
    result: Floats = pin.integrate(model, pin.neutral(model), turned)
    return result


def _fixed_at(name: str, fixed: Mapping[str, float],
              followers: Mapping[str, tuple[str, float, float]],
              seen: tuple[str, ...] = ()) -> float:
    """Return where a joint stands; one that follows another stands as that one asks for."""
    if name in fixed or name not in followers:
        return fixed.get(name, 0.0)
    if name in seen:
        raise InvalidTask(f'urdf: the joint {name!r} follows itself')
    leader, multiplier, offset = followers[name]
    return multiplier * _fixed_at(leader, fixed, followers, (*seen, name)) + offset


def _limits(model: Any, names: Sequence[str]) -> Floats:
    """Return lower and upper limits and speeds (m,) of joints."""
    limits = []
    for name in names:
        joint = model.joints[model.getJointId(name)]
        lower, upper, speed = (-np.inf, np.inf, model.velocityLimit[joint.idx_v])
        if joint.nq != _FREE_ANGLE:
            lower = model.lowerPositionLimit[joint.idx_q]
            upper = model.upperPositionLimit[joint.idx_q]
            if not lower < upper:
                raise InvalidTask(f'urdf: the joint {name!r} has the limits {lower:g} and '
                                  f'{upper:g}: expected lower < upper')
        if not speed > 0:
            raise InvalidTask(f'urdf: the joint {name!r} has the velocity limit {speed:g}: '
                              'expected more than 0')
        limits.append((lower, upper, speed))
    return np.array(limits).T
