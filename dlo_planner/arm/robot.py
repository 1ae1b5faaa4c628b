# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A robot arm by Pinocchio: where its tool link is, and how near its links come to each other.

Distances are those of the convex hulls of the collision shapes. Hulls are solid and contain the
shapes: what is clear of each other by its hulls is clear.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.checks import instance, items, number, row, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import FrozenDict, Value, brief, put

_REMEDY = ("the joints of an arm need Pinocchio: expected the extra 'dlo_planner[arm]' "
           '(package `pin` of PyPI, ros-jazzy-pinocchio of ROS)')
_LINK, _FIXED = 'link ', 'fixed '  # before names of frames
_FREE_ANGLE = 2  # numbers of a joint that turns for ever: cosine and sine
_PACKAGE, _FILE = 'package://', 'file://'


@dataclass(frozen=True, eq=False, repr=False)
class Arm(Value):
    """A robot that carries the gripper; joints that are not its own stay where they are.

    Attributes
    ----------
    urdf : str
        Text of the robot's URDF.
    tool_link : str
        Link whose frame is the tool frame.
    joints : tuple of str
        Names of those that move, in the order of all arrays; empty: all that move the tool.
    fixed : dict
        rad or m, where other joints stand; those not named stand at 0, or where they follow another
        one.
    base : Pose
        Pose of the URDF's root link in the world.
    packages : tuple of str
        Folders in which the packages of meshes are (`package://`).
    srdf : str or None
        Text of the SRDF, which says what pairs of links are not looked at. If None, pairs that a
        joint links, and those that touch with all joints at 0, or at the limit next to it.
    self_clearance : float
        By how much links have to stay clear of each other, m.

    Raises
    ------
    InvalidTask
        Naming the argument; or Pinocchio is not installed.
    """

    urdf: str
    tool_link: str
    joints: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=FrozenDict)
    base: Pose = field(default_factory=Pose.identity)
    packages: tuple[str, ...] = ()
    srdf: str | None = None
    self_clearance: float = 0.005

    def __post_init__(self) -> None:
        instance('urdf', self.urdf, str)
        instance('tool_link', self.tool_link, str)
        instance('base', self.base, Pose)
        instance('fixed', self.fixed, Mapping)
        if self.srdf is not None:
            parsed('srdf', self.srdf)
        put(self, joints=items('joints', self.joints, str),
            packages=items('packages', self.packages, str),
            self_clearance=number('self_clearance', self.self_clearance, minimum=0),
            fixed=FrozenDict((name, number(f'fixed[{shown(name)}]', value))
                             for name, value in self.fixed.items()))
        put(self, joints=self.chain.names)  # builds it, which judges the rest
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, self.tool_link, f'{len(self.joints)} joints')

    @property
    def lower(self) -> Floats:
        """(m,) lower limits of the joints, rad or m; -inf for one that turns for ever."""
        return self.chain.lower

    @property
    def upper(self) -> Floats:
        """(m,) upper limits of the joints, rad or m; inf for one that turns for ever."""
        return self.chain.upper

    @property
    def speeds(self) -> Floats:
        """(m,) largest speeds of the joints, rad/s or m/s."""
        return self.chain.speeds

    @property
    def carriers(self) -> tuple[str, ...]:
        """Joints that move the tool too, but are not the arm's: they stand as `fixed` says."""
        return self.chain.carriers

    @property
    def units(self) -> list[str]:
        """M units of the joints' positions, 'rad' or 'm'."""
        return ['rad' if turning else 'm' for turning in self.chain.turning]

    def pose(self, positions: ArrayLike) -> Pose:
        """Return the Pose of the tool link in the world at joint positions (m,), rad or m.

        Raises
        ------
        InvalidTask
            Not m finite numbers.
        """
        place, turn = self.chain.placement(self.checked('positions', positions))
        return self.base.compose(Pose.from_rotation(place, turn))

    def checked(self, name: str, positions: ArrayLike) -> Floats:
        """Return joint positions (m,) as a new array, or raise InvalidTask."""
        count = len(self.joints)
        return row(name, positions, least=count, most=count, minimum=-1e6, maximum=1e6)

    @cached_property
    def chain(self) -> 'Chain':
        """The kinematics of the joints."""
        return Chain(self.urdf, self.tool_link, self.joints, self.fixed)

    @cached_property
    def collision(self) -> 'SelfCollision':
        """The pairs of links that have to stay clear of each other."""
        return SelfCollision(self.chain, self.urdf, self.packages, self.srdf)


class Chain:
    """The m joints that move a link: Pinocchio's model with all other joints fixed."""

    names: tuple[str, ...]
    lower: Floats      # rad or m; infinite where there is none
    upper: Floats
    speeds: Floats     # rad/s or m/s
    turning: Bools     # which are angles
    carriers: tuple[str, ...]  # other joints that move the link
    model: Any         # pinocchio.Model of the joints alone

    def __init__(self, urdf: str, tool_link: str, joints: Sequence[str],
                 fixed: Mapping[str, float]) -> None:
        pin, root = pinocchio(), parsed('urdf', urdf)
        try:
            full = pin.buildModelFromXML(urdf)
        except Exception as error:  # Boost.Python: any may come
            raise InvalidTask(f'urdf = {shown(urdf)}: expected a robot; {error}') from None
        # of each joint that follows another: its leader, multiplier and offset
        followers = {joint.get('name', ''): (
            mimic.get('joint', ''), float(mimic.get('multiplier', 1)),
            float(mimic.get('offset', 0))) for joint in root.findall('joint')
            if (mimic := joint.find('mimic')) is not None}
        if not full.existFrame(tool_link, pin.BODY):
            links = [frame.name for frame in full.frames if frame.type == pin.BODY]
            raise InvalidTask(f'tool_link = {tool_link!r}: expected a link of the URDF, one of '
                              f'{shown(links)}')
        parent = full.frames[full.getFrameId(tool_link, pin.BODY)].parentJoint
        moving = [full.names[k] for k in full.supports[parent] if k]
        self.names = tuple(joints or (name for name in moving if name not in followers))
        _check_joints(full, self.names, moving, followers)
        self.carriers = tuple(name for name in moving if name not in (*self.names, *followers))
        self._full = full
        self._others = [k for k in range(1, full.njoints) if full.names[k] not in self.names]
        self._standing = _standing(full, self._others, fixed, followers)
        # in a URDF a link and a joint may have one name, with which Pinocchio cannot fix joints
        self._named = full.copy()
        prefixes = {pin.BODY: _LINK, pin.FIXED_JOINT: _FIXED}
        for frame in self._named.frames:
            frame.name = prefixes.get(frame.type, '') + frame.name
        self.model = pin.buildReducedModel(self._named, self._others, self._standing)
        self._frame = self.model.getFrameId(_LINK + tool_link, pin.BODY)
        self.data = self.model.createData()
        self.ids = [self.model.getJointId(name) for name in self.names]
        moved = [self.model.joints[k] for k in self.ids]
        self._free = np.array([joint.nq == _FREE_ANGLE for joint in moved])
        self._columns = np.array([joint.idx_v for joint in moved])
        self._places = np.array([joint.idx_q for joint in moved])
        self.turning = np.array(['P' not in joint.shortname().removeprefix('JointModel')
                                 for joint in moved])
        self.lower, self.upper, self.speeds = np.array([
            _limits(self.model, name, joint) for name, joint in zip(
                self.names, moved, strict=True)]).T

    def hulls(self, urdf: str) -> Any:
        """Return the GeometryModel of the collision elements, meshes as their convex hulls."""
        pin = pinocchio()
        try:
            shapes = pin.buildGeomFromUrdfString(self._full, urdf, pin.GeometryType.COLLISION)
        except Exception as error:  # Boost.Python: any may come
            raise InvalidTask(f'urdf: a collision shape cannot be read; {error}') from None
        for shape in shapes.geometryObjects:
            if hasattr(shape.geometry, 'buildConvexHull'):
                shape.geometry.buildConvexHull(True, 'Qt')
                shape.geometry = shape.geometry.convex
        return pin.buildReducedModel(self._named, shapes, self._others, self._standing)[1]

    def configuration(self, positions: Floats) -> Floats:
        """Return Pinocchio's configuration for joint positions (m,)."""
        out = np.empty(self.model.nq)
        out[self._places] = np.where(self._free, np.cos(positions), positions)
        out[self._places[self._free] + 1] = np.sin(positions[self._free])
        return out

    def placement(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return the link's position (3,) and rotation (3, 3) in the root link."""
        pin = pinocchio()
        pin.forwardKinematics(self.model, self.data, self.configuration(positions))
        place = pin.updateFramePlacement(self.model, self.data, self._frame)
        return place.translation.copy(), place.rotation.copy()

    def off(self, positions: Floats, place: Floats, turn: Floats) -> tuple[Floats, Floats]:
        """Return by what (6,) the link is off a placement (m, rad; root axes), and its Jacobian."""
        pin = pinocchio()
        jacobian = pin.computeFrameJacobian(
            self.model, self.data, self.configuration(positions), self._frame,
            pin.LOCAL_WORLD_ALIGNED)[:, self._columns]
        here, axes = self.placement(positions)
        return np.concatenate([place - here, pin.log3(turn @ axes.T)]), jacobian

    @property
    def middle(self) -> Floats:
        """(m,) middles of the ranges; 0 where there is none."""
        with np.errstate(invalid='ignore'):
            return np.where(np.isfinite(self.upper - self.lower),
                            0.5 * (self.lower + self.upper), 0.0)


class SelfCollision:
    """The pairs of links of a Chain that are looked at."""

    missing: tuple[str, ...]  # links without a shape to be looked at, with what is missing
    pairs: list[tuple[str, ...]]  # names of both links

    def __init__(self, chain: Chain, urdf: str, packages: Sequence[str], srdf: str | None) -> None:
        root = parsed('urdf', urdf)
        self._chain = chain
        self.missing = tuple(_resolve_meshes(root, packages))
        self._shapes = chain.hulls(ElementTree.tostring(root, encoding='unicode'))
        self._shapes.addAllCollisionPairs()  # but those of one body
        if not len(self._shapes.geometryObjects):
            self.missing = (*self.missing, 'no collision elements in the URDF')
        if srdf is None:
            parents = chain.model.parents
            self._keep(one.parentJoint not in (other.parentJoint, parents[other.parentJoint])
                       and parents[one.parentJoint] != other.parentJoint
                       for one, other in self._both())
            self._keep(self.distances(np.clip(0.0, chain.lower, chain.upper)) > 0)
        else:
            disabled = {frozenset((pair.get('link1', ''), pair.get('link2', '')))
                        for pair in parsed('srdf', srdf).iter('disable_collisions')}
            self._keep(frozenset(map(self._link, both)) not in disabled for both in self._both())
        self.pairs = [tuple(map(self._link, both)) for both in self._both()]
        self._levers = _levers(chain, self._shapes)

    def distances(self, positions: Floats) -> Floats:
        """Return the distance (p,) of each pair in m; below 0 they overlap."""
        pin, chain = pinocchio(), self._chain
        pin.computeDistances(chain.model, chain.data, self._shapes, self._data,
                             chain.configuration(positions))
        return np.array([result.min_distance for result in self._data.distanceResults])

    def way(self, moved: Floats) -> float:
        """Return by how much, m, joints' ways (m,), there and back, change a distance at most."""
        return float(np.abs(moved) @ self._levers)

    def _both(self) -> list[tuple[Any, Any]]:
        objects = self._shapes.geometryObjects
        return [(objects[pair.first], objects[pair.second])
                for pair in self._shapes.collisionPairs]

    def _link(self, shape: Any) -> str:
        return str(self._chain.model.frames[shape.parentFrame].name.removeprefix(_LINK))

    def _keep(self, wanted: Iterable[bool]) -> None:
        """Keep those of the pairs of shapes for which `wanted` is true."""
        kept = [(pair.first, pair.second) for pair, keep in zip(
            self._shapes.collisionPairs, list(wanted), strict=True) if keep]
        self._shapes.removeAllCollisionPairs()
        for both in kept:
            self._shapes.addCollisionPair(pinocchio().CollisionPair(*both))
        self._data = self._shapes.createData()


def pinocchio() -> Any:
    """Return the module, which is an extra."""
    try:
        import pinocchio as module  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise InvalidTask(f'{_REMEDY}; {error}') from None
    if not hasattr(module, 'buildReducedModel'):
        raise InvalidTask(f'{_REMEDY}; {getattr(module, "__file__", None)} is another package')
    return module


def _check_joints(model: Any, names: Sequence[str], moving: Sequence[str],
                  followers: Mapping[str, tuple[str, float, float]]) -> None:
    """Raise InvalidTask unless the joints are known, move the link, and lead no other ones."""
    if not names:
        raise InvalidTask('joints = (): the tool_link does not move: expected a link beyond joints')
    for index, name in enumerate(names):
        joint = f'joints[{index}] = {name!r}'
        if not model.existJointName(name):
            raise InvalidTask(f'{joint}: expected a movable joint of the URDF, one of '
                              f'{shown(list(model.names)[1:])}')
        if name in names[:index]:
            raise InvalidTask(f'{joint}: expected each joint once')
        if name not in moving:
            raise InvalidTask(f'{joint}: expected one that moves the tool_link: '
                              f'{", ".join(moving)}')
        if model.joints[model.getJointId(name)].nv != 1:
            raise InvalidTask(f'{joint}: expected a revolute, continuous or prismatic joint')
        if name in followers:
            raise InvalidTask(f'{joint} follows {followers[name][0]!r}: expected a joint with a '
                              'drive of its own')
    for name, (leader, *_) in followers.items():
        if leader in names:
            raise InvalidTask(f'joints: {leader!r} drives {name!r} too, which is not supported: '
                              'expected joints that drive no other ones')


def _standing(model: Any, others: Sequence[int], fixed: Mapping[str, float],
              followers: Mapping[str, tuple[str, float, float]]) -> Floats:
    """Return a configuration of the whole robot with its fixed joints where they stand."""
    def position(name: str, seen: tuple[str, ...] = ()) -> float:
        if name in fixed or name not in followers:
            return fixed.get(name, 0.0)
        if name in seen:
            raise InvalidTask(f'urdf: the joint {name!r} follows itself')
        leader, multiplier, offset = followers[name]
        return multiplier * position(leader, (*seen, name)) + offset

    pin = pinocchio()
    for name in fixed:
        if not model.existJointName(name):
            raise InvalidTask(f'fixed[{name!r}]: expected joints of the URDF, '
                              f'{shown(list(model.names)[1:])}')
    turned = np.zeros(model.nv)
    for k in others:
        name = model.names[k]
        if model.joints[k].nv == 1:
            turned[model.joints[k].idx_v] = position(name)
        elif name in fixed:
            raise InvalidTask(f'fixed[{name!r}] = {fixed[name]:g}: expected a joint with one '
                              'coordinate')
    result: Floats = pin.integrate(model, pin.neutral(model), turned)
    return result


def _limits(model: Any, name: str, joint: Any) -> tuple[float, float, float]:
    """Return lower and upper limit and largest speed of a joint."""
    lower, upper, speed = -np.inf, np.inf, model.velocityLimit[joint.idx_v]
    if joint.nq != _FREE_ANGLE:
        lower = model.lowerPositionLimit[joint.idx_q]
        upper = model.upperPositionLimit[joint.idx_q]
        if not lower < upper:
            raise InvalidTask(f'urdf: the joint {name!r} has the limits {lower:g} and {upper:g}: '
                              'expected lower < upper')
    if not speed > 0:
        raise InvalidTask(f'urdf: the joint {name!r} has the velocity limit {speed:g}: expected '
                          'more than 0')
    return lower, upper, speed


def _levers(chain: Chain, shapes: Any) -> Floats:
    """Return for each joint (m,) by how much it can move a point of a link at most, per unit.

    1 for one that slides; for one that turns, the longest way from it to a point beyond it, all
    links stretched out, sliding ones as far as they go.
    """
    model = chain.model
    beyond = np.zeros(model.njoints)
    for shape in shapes.geometryObjects:
        shape.geometry.computeLocalAABB()
        far = np.linalg.norm(shape.placement.act(shape.geometry.aabb_center))
        beyond[shape.parentJoint] = max(beyond[shape.parentJoint],
                                        far + shape.geometry.aabb_radius)
    slides = {k: max(abs(low), abs(high)) for k, low, high, turning in zip(
        chain.ids, chain.lower, chain.upper, chain.turning, strict=True) if not turning}
    for k in range(model.njoints - 1, 0, -1):
        way = np.linalg.norm(model.jointPlacements[k].translation) + slides.get(k, 0.0)
        beyond[model.parents[k]] = max(beyond[model.parents[k]], beyond[k] + way)
    return np.where(chain.turning, beyond[chain.ids], 1.0)


# What is read from the text of a URDF or SRDF itself.


def parsed(name: str, text: str) -> ElementTree.Element:
    """Return the <robot> element of an XML text that callers know by `name`; raise InvalidTask."""
    instance(name, text, str)
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InvalidTask(f'{name} = {shown(text)}: expected XML; {error}') from None
    if root.tag != 'robot':
        raise InvalidTask(f'{name} has the element <{root.tag}>: expected <robot>')
    return root


def single_joints(root: ElementTree.Element) -> set[str]:
    """Return the names of the joints with one coordinate."""
    return {joint.get('name', '') for joint in root.findall('joint')
            if joint.get('type') in ('revolute', 'continuous', 'prismatic')}


def _resolve_meshes(root: ElementTree.Element, packages: Sequence[str]) -> list[str]:
    """Make the paths of collision meshes absolute; take those out, and name, that are not there."""
    missing = []
    for link in root.findall('link'):
        for visual in link.findall('visual'):
            link.remove(visual)
        for collision in link.findall('collision'):
            mesh = collision.find('geometry/mesh')
            if mesh is None:
                continue
            path = _path_of(mesh.get('filename', ''), packages)
            if path is None:
                link.remove(collision)
                missing.append(f'{link.get("name")} ({mesh.get("filename")})')
            else:
                mesh.set('filename', str(path))
    return missing


def _path_of(filename: str, packages: Sequence[str]) -> Path | None:
    """Return the Path of a mesh, or None if it is not there.

    `package://name/rest` is looked for as `folder/name/rest`, and as `folder/rest` where the folder
    itself has that name.
    """
    places = [Path(filename.removeprefix(_FILE))]
    if filename.startswith(_PACKAGE):
        package, _, rest = filename[len(_PACKAGE):].partition('/')
        places = [place for folder in map(Path, packages)
                  for place in (folder / package / rest,
                                *([folder / rest] if folder.name == package else []))]
    return next((place.absolute() for place in places if place.is_file()), None)
