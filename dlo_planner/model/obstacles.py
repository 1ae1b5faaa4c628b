# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO may touch, and what that is drawn with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import (
    array,
    direction,
    flag,
    instance,
    items,
    number,
    shown,
    vector,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import MOST, Surface, closed, hull, mended, read
from dlo_planner.model.value import Value, put

# ------------------------------------------------------------------------------------------------
# What obstacles are drawn with: bodies that RViz, browsers and physics engines know.


class Solid(NamedTuple):
    """A body that RViz, browsers and physics engines know: what obstacles are drawn with."""

    # 'box', 'ball' (an ellipsoid), 'cylinder' (flat ends, its axis along z) or 'mesh'
    kind: str
    pose: Pose  # pose of its center; of a mesh, of its frame
    size: tuple[float, float, float]  # (3,) full sizes along the axes of the pose, m
    surface: Surface | None = None  # of a mesh, its triangles


def bar(start: Floats, end: Floats, radius: float) -> Solid:
    """Return the cylinder between two points (3,), m."""
    along = end - start
    pose = Pose.looking_along(0.5 * (start + end), along)
    return Solid('cylinder', Pose.from_rotation(pose.position, pose.rotation[:, [1, 2, 0]]),
                 (2 * radius, 2 * radius, float(np.linalg.norm(along))))


def ball(center: Floats, radius: float) -> Solid:
    """Return the ball around a point (3,), m."""
    return Solid('ball', Pose(center, (0.0, 0.0, 0.0, 1.0)), (2 * radius,) * 3)


# ------------------------------------------------------------------------------------------------
# What kernels know obstacles by.


class Body(NamedTuple):
    """A convex body, a sheet or a mesh: how `energy.scene` computes its distance, and of what.

    Convex, because the plane at its nearest point is taken as a bound of all of it; of sheets and
    meshes it is not.
    """

    kind: str  # one of `energy.scene.KINDS`
    pose: Pose  # pose of its center
    size: ArrayLike  # (3,) half sizes along the axes of the pose, m; see `energy.scene.Scene`
    inner: float = 0.0  # how deep in it a point still knows its way out, m
    surface: Surface | None = None  # of a mesh or a hull, its triangles
    smooth: bool = False  # a mesh whose edges are rounded where it is touched


# ------------------------------------------------------------------------------------------------
# What a DLO may touch: plane, sphere, capsule, cylinder, box, ellipsoid, sheet with cut-outs, mesh,
# convex hull.


_FLUSH = 1e-6  # of the sheet, and rad: how far a cut-out may lie off its sheet's middle plane
_NO_LENGTH = 1e-9  # of its other measures: a capsule that short has no direction
_ROUNDING = 1e-9   # of the sheet
_LONGEST_NAME = 256  # characters, so that a refusal can be read


@dataclass(frozen=True, eq=False, repr=False)
class Named(Value):
    """Base of obstacles: how one is called in answers and refusals.

    Two obstacles that fill the same place are equal, whatever they are called.

    Attributes
    ----------
    name : str
        A line of text; '' if it has no name, and is called by its class and its index.
    """

    name: str = field(default='', kw_only=True, compare=False)

    def __post_init__(self) -> None:
        _judge_name(f'{type(self).__name__}.name', self.name)
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class Plane(Named):
    """A floor or wall that fills everything behind it.

    Attributes
    ----------
    point : ndarray, shape (3,)
        Point in m, on the surface.
    normal : ndarray, shape (3,)
        Normal of any length but zero, pointing away from the solid.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    point: Floats
    normal: Floats
    friction: float = 0.0

    if TYPE_CHECKING:  # what may be given, here and below
        def __init__(self, point: ArrayLike, normal: ArrayLike, friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        put(self, point=vector('Plane.point', self.point, 3),
            normal=direction('Plane.normal', self.normal), friction=_friction(self))
        super().__post_init__()

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        return (Body('plane', Pose.looking_along(self.point, self.normal), (0, 0, 0)),)


@dataclass(frozen=True, eq=False, repr=False)
class Sphere(Named):
    """A ball.

    Attributes
    ----------
    center : ndarray, shape (3,)
        Center in m.
    radius : float
        Radius in m.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    center: Floats
    radius: float
    friction: float = 0.0

    if TYPE_CHECKING:
        def __init__(self, center: ArrayLike, radius: float, friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        put(self, center=vector('Sphere.center', self.center, 3),
            radius=number('Sphere.radius', self.radius, above=0), friction=_friction(self))
        super().__post_init__()

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        return (Body('sphere', Pose(self.center, (0, 0, 0, 1)), (0, 0, self.radius), self.radius),)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (ball(self.center, self.radius),)


@dataclass(frozen=True, eq=False, repr=False)
class _Bar(Named):
    """Base of what is round about a line: it checks."""

    start: Floats
    end: Floats
    radius: float
    friction: float = 0.0

    if TYPE_CHECKING:
        def __init__(self, start: ArrayLike, end: ArrayLike, radius: float,
                     friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        name = type(self).__name__
        put(self, start=vector(f'{name}.start', self.start, 3),
            end=vector(f'{name}.end', self.end, 3),
            radius=number(f'{name}.radius', self.radius, above=0), friction=_friction(self))
        size = max(self.radius, np.abs(self.start).max(), np.abs(self.end).max())
        if np.linalg.norm(self.end - self.start) <= _NO_LENGTH * size:
            raise InvalidTask(f'{name}.end = {self.end.tolist()}: expected another point than '
                              'start, apart by more than rounding of their places and the radius '
                              '(what has one center is a Sphere)')
        super().__post_init__()

    @property
    def _line(self) -> tuple[Pose, float]:
        """Pose of its center, x along it, and half its length in m."""
        along = self.end - self.start
        return (Pose.looking_along(0.5 * (self.start + self.end), along),
                float(0.5 * np.linalg.norm(along)))

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (bar(self.start, self.end, self.radius),)


class Capsule(_Bar):
    """A round bar with round ends: all points within `radius` of the line from start to end.

    Attributes
    ----------
    start : ndarray, shape (3,)
        One end of the line, m.
    end : ndarray, shape (3,)
        Other end of the line, m, different from start.
    radius : float
        Radius in m.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        pose, half = self._line
        return (Body('capsule', pose, (half, 0, self.radius), self.radius),)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (*super().solids, ball(self.start, self.radius), ball(self.end, self.radius))


class Cylinder(_Bar):
    """A round bar with flat ends; only a DLO with a round section may touch it.

    Attributes
    ----------
    start : ndarray, shape (3,)
        Center of one end, m.
    end : ndarray, shape (3,)
        Center of the other end, m, different from start.
    radius : float
        Radius in m.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        pose, half = self._line
        return (Body('cylinder', pose, (half, self.radius, 0), min(half, self.radius)),)


@dataclass(frozen=True, eq=False, repr=False)
class Box(Named):
    """A rectangular block.

    Attributes
    ----------
    pose : Pose
        Pose of its center.
    size : ndarray, shape (3,)
        Full sizes along the pose's axes, m.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    pose: Pose
    size: Floats
    friction: float = 0.0

    if TYPE_CHECKING:
        def __init__(self, pose: Pose, size: ArrayLike, friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Box.pose', self.pose, Pose)
        put(self, size=_lengths('Box.size', self.size), friction=_friction(self))
        super().__post_init__()

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        return (Body('box', self.pose, 0.5 * self.size, 0.5 * self.size.min()),)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (Solid('box', self.pose, tuple(self.size)),)


@dataclass(frozen=True, eq=False, repr=False)
class Ellipsoid(Named):
    """An ellipsoid; only a DLO with a round section may touch it.

    Attributes
    ----------
    pose : Pose
        Pose of its center.
    half_axes : ndarray, shape (3,)
        Half axes along the pose's axes, m.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    pose: Pose
    half_axes: Floats
    friction: float = 0.0

    if TYPE_CHECKING:
        def __init__(self, pose: Pose, half_axes: ArrayLike, friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Ellipsoid.pose', self.pose, Pose)
        put(self, half_axes=_lengths('Ellipsoid.half_axes', self.half_axes),
            friction=_friction(self))
        super().__post_init__()

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        # within the radius of its sharpest bend there is one way out
        inner = float(self.half_axes.min() ** 2 / self.half_axes.max())
        return (Body('ellipsoid', self.pose, self.half_axes, inner),)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (Solid('ball', self.pose, tuple(2 * self.half_axes)),)


@dataclass(frozen=True, eq=False, repr=False)
class Sheet(Named):
    """A flat rectangular plate with cut-outs; the x axis of its pose is its normal.

    Attributes
    ----------
    pose : Pose
        Pose of the middle of the plate.
    width : float
        Width along the pose's y axis, m.
    height : float
        Height along the pose's z axis, m.
    thickness : float
        Thickness in m, may be 0.
    cutouts : tuple of CutOut
        CutOuts with a size, centered in the middle plane, normal to it.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.

    Raises
    ------
    InvalidTask
        A cut-out without size, or one that does not lie in the sheet.
    """

    pose: Pose
    width: float
    height: float
    thickness: float = 1e-3
    cutouts: tuple[CutOut, ...] = ()
    friction: float = 0.0

    if TYPE_CHECKING:
        def __init__(self, pose: Pose, width: float, height: float, thickness: float = 1e-3,
                     cutouts: Iterable[CutOut] | CutOut = (), friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Sheet.pose', self.pose, Pose)
        cutouts = (self.cutouts,) if isinstance(self.cutouts, CutOut) else self.cutouts
        put(self, width=number('Sheet.width', self.width, above=0),
            height=number('Sheet.height', self.height, above=0),
            thickness=number('Sheet.thickness', self.thickness, minimum=0),
            cutouts=items('Sheet.cutouts', cutouts, CutOut), friction=_friction(self))
        for index, cutout in enumerate(self.cutouts):
            self._check(f'Sheet.cutouts[{index}]', cutout)
        super().__post_init__()

    @classmethod
    def around(cls, cutout: CutOut, width: float = 0.4, height: float = 0.4,
               thickness: float = 1e-3, friction: float = 0.0, *, name: str = '') -> Sheet:
        """Return a sheet with one cut-out in its center."""
        instance('cutout', cutout, CutOut)
        return cls(cutout.pose, width, height, thickness, (cutout,), friction, name=name)

    def _check(self, name: str, cutout: CutOut) -> None:
        if cutout.radius is None and cutout.width is None:
            raise InvalidTask(f'{name} = {shown(cutout)}: expected a CutOut with radius or width')
        local = self.pose.rotation.T @ (cutout.center - self.pose.position)
        tilt = np.linalg.norm(np.cross(self.pose.direction, cutout.normal))
        size = max(self.width, self.height, np.abs(self.pose.position).max())
        if abs(local[0]) > _FLUSH * size or tilt > _FLUSH:
            raise InvalidTask(f'{name}: expected its center in the sheet\'s middle plane and its '
                              f'normal along the sheet\'s, got {local[0]:.3g} m and {tilt:.3g} off')
        half = 0.5 * np.array([self.width, self.height])
        if (np.abs(local[1:]) + self._reach(cutout) > half + _ROUNDING * size).any():
            raise InvalidTask(f'{name} = {shown(cutout)}: expected to lie within the sheet\'s '
                              f'width of {self.width:g} m and height of {self.height:g} m')

    def _reach(self, cutout: CutOut) -> Floats:
        """Return how far (2,) a cut-out reaches from its center along the sheet's y and z, m."""
        if cutout.radius is not None:
            return np.full(2, cutout.radius)
        roll = self.pose.rotation[:, 1:].T @ cutout.pose.rotation[:, 1:]
        reach: Floats = 0.5 * np.abs(roll) @ np.array([cutout.width, cutout.height])
        return reach


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Named):
    """A solid inside of triangles, of any shape; only a DLO with a round section may touch it.

    What is promised of it (clearance, that nothing passes through, penetration) is told by the
    exact distance from the triangles.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        Vertices in m, in the frame of the pose.
    faces : ndarray of int, shape (m, 3)
        Indices of the vertices of each triangle, counterclockwise as seen from outside.
    pose : Pose
        Pose of the frame of the vertices.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    smooth : bool
        Whether the DLO touches a smooth surface in place of the triangles, for what is round: its
        edges and creases are rounded on the scale of half the DLO's radius. False: the triangles
        themselves, for what has few, flat faces.
    name : str
        How it is called; '' if it has no name.

    Raises
    ------
    InvalidTask
        Triangles that do not enclose a solid: with open edges, flat ones, or seen from within.
    """

    vertices: Floats
    faces: Ints
    pose: Pose = Pose.identity()  # noqa: RUF009 - frozen
    friction: float = 0.0
    smooth: bool = True

    if TYPE_CHECKING:
        def __init__(self, vertices: ArrayLike, faces: ArrayLike, pose: Pose = ...,
                     friction: float = 0.0, smooth: bool = True, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Mesh.pose', self.pose, Pose)
        vertices = array('Mesh.vertices', self.vertices, (None, 3))
        faces = _whole('Mesh.faces', self.faces)
        closed('Mesh', vertices, faces)
        put(self, vertices=vertices, faces=faces, friction=_friction(self),
            smooth=flag('Mesh.smooth', self.smooth))
        super().__post_init__()

    @classmethod
    def read(cls, path: str | PathLike[str], unit: str | None = None,
             pose: Pose = Pose.identity(), friction: float = 0.0,  # noqa: B008 - frozen
             smooth: bool = True) -> Self:
        """Return the Mesh of a file: STL, OBJ, PLY, GLB or 3MF.

        Vertices at one place are joined, triangles without area go, and triangles that are seen
        from within are turned; holes are not filled.

        Parameters
        ----------
        path : str or PathLike
            File.
        unit : str, optional
            Unit of the numbers in the file: 'm', 'mm', 'cm' or 'in'. If None, the file has to say
            it, as GLB (m) and 3MF do.
        pose : Pose, optional
            Pose of the file's frame.
        friction : float, optional
            Coulomb's coefficient, >= 0.
        smooth : bool, optional
            See `Mesh`.

        Returns
        -------
        Mesh

        Raises
        ------
        InvalidTask
            No such file, another kind of file, a unit that nobody has said, or triangles that do
            not enclose a solid.
        MissingExtra
            The package that reads such files is not there.
        """
        found = read(path, unit)
        try:
            return cls(*found, pose, friction, smooth)
        except InvalidTask as error:
            raise InvalidTask(f'path = {shown(str(path))}: {error}') from None

    @classmethod
    def mended(cls, vertices: ArrayLike, faces: ArrayLike,
               pose: Pose = Pose.identity(), friction: float = 0.0,  # noqa: B008 - frozen
               smooth: bool = True) -> Self:
        """Return a Mesh of triangles as they come from elsewhere: mended as by `read`.

        Parameters
        ----------
        vertices : array_like, shape (n, 3)
            Vertices in m, in the frame of the pose.
        faces : array_like of int, shape (m, 3)
            Indices of the vertices of each triangle.
        pose, friction, smooth
            See `Mesh`.

        Returns
        -------
        Mesh

        Raises
        ------
        InvalidTask
            Triangles that do not enclose a solid.
        """
        given = array('vertices', vertices, (None, 3))
        indices = _whole('faces', faces)
        if ((indices < 0) | (indices >= len(given))).any():
            closed('Mesh', given, indices)  # which says what is wrong
        return cls(*mended(given, indices), pose, friction, smooth)

    @cached_property
    def surface(self) -> Surface:
        """The triangles, in the frame of the pose."""
        return Surface(self.vertices, self.faces)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        return (Body('mesh', self.pose, _reach_of(self.vertices), 0.0, self.surface, self.smooth),)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (Solid('mesh', self.pose, (1.0, 1.0, 1.0), self.surface),)


@dataclass(frozen=True, eq=False, repr=False)
class Hull(Named):
    """The convex hull of points; only a DLO with a round section may touch it.

    Its faces are flat and its edges sharp. What is round is better an `Ellipsoid`, or a `Mesh`.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Points in m, in the frame of the pose; four or more, not in a plane.
    pose : Pose
        Pose of the frame of the points.
    friction : float
        Coulomb's coefficient, >= 0.
    name : str
        How it is called; '' if it has no name.
    """

    points: Floats
    pose: Pose = Pose.identity()  # noqa: RUF009 - frozen
    friction: float = 0.0

    if TYPE_CHECKING:
        def __init__(self, points: ArrayLike, pose: Pose = ..., friction: float = 0.0, *,
                     name: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Hull.pose', self.pose, Pose)
        points = array('Hull.points', self.points, (None, 3))
        put(self, points=points, friction=_friction(self), surface=hull('Hull.points', points))
        super().__post_init__()

    @cached_property
    def surface(self) -> Surface:
        """The triangles of the hull, in the frame of the pose."""
        return hull('Hull.points', self.points)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """What it is for kernels."""
        vertices, faces = self.surface
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        heights = np.einsum('ij,ij->i', normals, a - vertices.mean(axis=0))
        inner = float((heights / np.linalg.norm(normals, axis=1)).min())
        return (Body('hull', self.pose, _reach_of(vertices), inner, self.surface),)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it looks like."""
        return (Solid('mesh', self.pose, (1.0, 1.0, 1.0), self.surface),)


Obstacle: TypeAlias = Plane | Sphere | Capsule | Cylinder | Box | Ellipsoid | Sheet | Mesh | Hull
OBSTACLES: tuple[type, ...] = get_args(Obstacle)


def called(obstacle: Obstacle, index: int) -> str:
    """Return how an obstacle is called in a sentence: by its name, else by its class and index."""
    return obstacle.name or f'{type(obstacle).__name__} {index}'


def _judge_name(name: str, value: object) -> None:
    if not isinstance(value, str) or len(value) > _LONGEST_NAME or not (
            value.isprintable() and value == value.strip()):
        raise InvalidTask(f'{name} = {shown(value)}: expected a line of at most {_LONGEST_NAME} '
                          'characters, which neither begins nor ends with a space')


def _friction(self: Any) -> float:
    return number(f'{type(self).__name__}.friction', self.friction, minimum=0)


def _lengths(name: str, value: ArrayLike) -> Floats:
    """Return (3,) lengths, m, each above 0."""
    return np.array([number(f'{name}[{k}]', length, above=0)
                     for k, length in enumerate(vector(name, value, 3))])


def _whole(name: str, value: ArrayLike) -> Ints:
    """Return (m, 3) indices; numbers that are not whole are refused."""
    given = array(name, value, (None, 3))
    if len(given) > MOST:
        raise InvalidTask(f'{name} has {len(given)} rows: expected {MOST} triangles at most')
    if (given != np.round(given)).any():
        raise InvalidTask(f'{name} = {shown(given.tolist())}: expected whole numbers, indices of '
                          'vertices')
    return given.astype(np.int64)


def _reach_of(vertices: Floats) -> Floats:
    """Return (3,) how far vertices reach from the origin along each axis, m."""
    return np.asarray(np.abs(vertices).max(axis=0), dtype=float)
