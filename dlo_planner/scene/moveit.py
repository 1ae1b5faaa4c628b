# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""MoveIt's text files of a planning scene, `.scene`: objects of boxes, spheres, ... and meshes.

Both forms are read: that of MoveIt 2 and Noetic, in which an object has a pose and subframes, and
the older one without. What the format has no words for (friction, cut-outs, which shapes are one
capsule) is written as subframes whose names begin with `dlo:`; MoveIt keeps them, and does nothing
by them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import cos, pi, tau
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import did_you_mean, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.files import text_of
from dlo_planner.model.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Hull,
    Mesh,
    Obstacle,
    Plane,
    Sheet,
    Sphere,
)
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import Surface, hull
from dlo_planner.scene.content import NO_TURN, Asked, Content, pierced, solids_of
from dlo_planner.scene.plates import pieces_of

_NUMBERS: dict[str, tuple[str, ...]] = {  # of a shape, by its name in the file
    'sphere': ('radius',), 'box': ('x', 'y', 'z'), 'cylinder': ('radius', 'length'),
    'cone': ('radius', 'length'), 'plane': ('a', 'b', 'c', 'd'), 'mesh': ('vertices', 'triangles')}
_POSE = ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')
_OURS = 'dlo:'
_ALIKE = 1e-9  # m, and relative: a ball that ends a cylinder
_CONE_SIDES = 32  # of the pyramid around a cone: 0.5 % wider than it at its corners
_READ_AS = {'cone': f'a pyramid of {_CONE_SIDES} sides around it',
            'plane': 'solid behind its normal'}
_MOST_NAMED = 5  # objects, in a note
_MOST_SHAPES = 100_000  # of an object; more is a number that is none of them
_LARGEST = 2**28  # bytes of a file
_DIGITS = 17  # with which a number is read back as it was

# makes obstacles of their pose, and of what is asked for; a mesh may be several solids
Made = Callable[[Pose, Asked], list[Obstacle]]


class _Shape(NamedTuple):
    """A shape of an object."""

    made: Made
    pose: Pose
    triangles: Surface | None = None  # of a mesh, as they stand in the file


def read(path: Path, asked: Asked) -> Content:
    """Return what a MoveIt `.scene` says, in m; raise InvalidTask that names line and object."""
    words, content = _Words(path), Content()
    words.line()  # the name of the scene
    with_poses = words.has_object_poses()
    while (mark := words.word('* and an object, or . at the end')) == '*':
        name = words.line().strip()
        if not name:
            raise words.fault("expected the object's name after *")
        _read_object(words, name, with_poses, asked, content)
    if mark != '.':
        raise words.fault(f'expected * and an object, or . at the end, got {shown(mark)}')
    for kind, names in words.read_as.items():
        listed = ', '.join(map(repr, names[:_MOST_NAMED]))
        more = f' and {len(names) - _MOST_NAMED} more' if len(names) > _MOST_NAMED else ''
        content.notes.append(f'each {kind} is read as {_READ_AS[kind]}: {listed}{more}')
    return content.scaled(asked.unit)


def _read_object(words: _Words, name: str, with_poses: bool, asked: Asked,
                 content: Content) -> None:
    words.within = name
    pose = words.pose() if with_poses else Pose.identity()
    shapes = []
    for _ in range(words.count('the number of shapes', _MOST_SHAPES)):
        made, mesh = _read_shape(words, name, content)
        shapes.append(_Shape(made, pose.compose(words.pose()), mesh))
        words.numbers('the color', 4)
    said = _Said(asked)
    if with_poses:
        for _ in range(words.count('the number of subframes', _MOST_SHAPES)):
            label = words.word('the name of a subframe')
            said.take(label, pose.compose(words.pose()), words)
    try:
        _add(name, pose, shapes, said, content)
    except InvalidTask as error:  # which knows what is wrong, not where it stands
        raise words.fault(str(error).removeprefix(f'{name!r}: ')) from None


def _add(name: str, pose: Pose, shapes: Sequence[_Shape], said: _Said, content: Content) -> None:
    """Put an object into the content."""
    if said.whole is not None:  # one that `text_of_scene` wrote: its shapes are pieces of it
        content.obstacles.append(said.obstacle(name, pose))
        return
    if said.of_mesh is not None and len(shapes) == 1 and shapes[0].triangles is not None:
        found = [said.mesh(shapes[0].triangles, shapes[0].pose)]
    else:
        asked = said.asked._replace(friction=said.friction)
        found = _capsules([part for one in shapes for part in one.made(one.pose, asked)])
    if said.cutouts and len(found) == 1 and isinstance(found[0], Box):
        plate = pierced(found[0], said.cutouts)
        if plate is None:
            raise InvalidTask('expected its cut-outs straight through its box')
        found = [plate]
    else:
        content.cutouts += said.cutouts
    content.obstacles += [replace(one, name=name if len(found) == 1 else f'{name}/{k}')
                          for k, one in enumerate(found)]


def _read_shape(words: _Words, name: str, content: Content) -> tuple[Made, Surface | None]:
    kind = words.word('the kind of a shape')
    if kind not in _NUMBERS:
        raise words.fault(f'expected one of {", ".join(_NUMBERS)}, got {shown(kind)}'
                          f'{did_you_mean(kind, _NUMBERS)}')
    if kind == 'mesh':
        counts = [words.count(f'the number of {what}', 10_000_000) for what in _NUMBERS[kind]]
        vertices = np.array(words.numbers('vertices', 3 * counts[0])).reshape(-1, 3)
        faces = np.array(words.numbers('triangles', 3 * counts[1])).reshape(-1, 3)
        if not len(faces) or (faces != np.round(faces)).any() or not (
                (faces >= 0) & (faces < len(vertices))).all():
            raise words.fault(f'expected triangles of indices from 0 to {len(vertices) - 1}')
        triangles = Surface(vertices, faces.astype(np.int64))
        return _solids(triangles, name, content.notes), triangles
    sizes = words.numbers(f'{" ".join(_NUMBERS[kind])} of a {kind}', len(_NUMBERS[kind]))
    if kind != 'plane' and min(sizes) <= 0:
        raise words.fault(f'expected sizes above 0 of a {kind}, got {sizes}')
    if kind == 'plane' and not any(sizes[:3]):
        raise words.fault(f'expected a, b, c of a plane that are not all 0, got {sizes}')
    if kind in _READ_AS:
        words.read_as.setdefault(kind, []).append(name)
    return _MADE[kind](sizes), None


def _on_axis(pose: Pose, length: float) -> tuple[Floats, Floats]:
    """Return both ends (3,) of a line about the origin of a pose along its z axis."""
    half = 0.5 * length * pose.rotation[:, 2]
    return pose.position - half, pose.position + half


def _plane(numbers: Sequence[float]) -> Made:
    normal = np.array(numbers[:3])
    point = -numbers[3] * normal / (normal @ normal)
    return lambda pose, asked: [Plane(pose.position + pose.rotation @ point,
                                      pose.rotation @ normal, asked.friction)]


def _cone(numbers: Sequence[float]) -> Made:
    radius, length = numbers
    turns = tau * np.arange(_CONE_SIDES) / _CONE_SIDES
    out = radius / cos(pi / _CONE_SIDES)
    points = np.vstack([np.column_stack([out * np.cos(turns), out * np.sin(turns),
                                         np.full_like(turns, -0.5 * length)]),
                        (0.0, 0.0, 0.5 * length)])
    return lambda pose, asked: [Hull(points, pose, asked.friction)]


_MADE: dict[str, Callable[[Sequence[float]], Made]] = {
    'sphere': lambda sizes: lambda pose, asked: [
        Sphere(pose.position, sizes[0], asked.friction)],
    'box': lambda sizes: lambda pose, asked: [Box(pose, sizes, asked.friction)],
    'cylinder': lambda sizes: lambda pose, asked: [
        Cylinder(*_on_axis(pose, sizes[1]), sizes[0], asked.friction)],
    'cone': _cone, 'plane': _plane}


def _solids(triangles: Surface, name: str, notes: list[str]) -> Made:
    """Return what makes the obstacles of triangles; `name` and `notes` are for what is odd."""
    def made(pose: Pose, asked: Asked) -> list[Obstacle]:
        vertices = pose.position + triangles.vertices @ pose.rotation.T
        return solids_of(name, Surface(vertices, triangles.faces), asked, notes)
    return made


def _capsules(found: Sequence[Obstacle]) -> list[Obstacle]:
    """Return obstacles of one object: a cylinder, and then a ball at each end, are a Capsule."""
    out, k = list[Obstacle](), 0
    while k < len(found):
        bar, balls = found[k], found[k + 1:k + 3]
        if isinstance(bar, Cylinder) and len(balls) == 2 and all(
                isinstance(ball, Sphere) and abs(ball.radius - bar.radius) <= _ALIKE * bar.radius
                and np.abs(ball.center - end).max() <= _ALIKE * (1 + np.abs(end).max())
                for ball, end in zip(balls, (bar.start, bar.end), strict=True)):
            # the places of the balls are exact, those of the bar are rounded
            start, end = (ball.center for ball in balls if isinstance(ball, Sphere))
            out.append(Capsule(start, end, bar.radius, bar.friction))
            k += 3
        else:
            out.append(bar)
            k += 1
    return out


class _Said:
    """What subframes named `dlo:...` say of an object."""

    def __init__(self, asked: Asked) -> None:
        self.asked, self.friction = asked, asked.friction
        self.cutouts: list[CutOut] = []
        self.whole: tuple[str, Mapping[str, float]] | None = None
        self.of_mesh: tuple[str, Mapping[str, float]] | None = None

    def take(self, label: str, pose: Pose, words: _Words) -> None:
        """Take a subframe."""
        if not label.startswith(_OURS):
            return
        kind, _, text = label.removeprefix(_OURS).partition(':')
        try:
            values = {key: float(value) for key, value in (
                part.split('=') for part in text.split(',') if part)}
            if kind.startswith('cutout'):
                self.cutouts.append(CutOut(pose, **values))
            elif kind == 'friction':
                self.friction = values['friction']
            elif kind in ('sheet', 'ellipsoid'):
                self.whole = kind, values
            elif kind in ('mesh', 'hull'):
                self.of_mesh = kind, values
            else:
                raise ValueError
        except (ValueError, KeyError, TypeError):
            raise words.fault(f'subframe {shown(label)}: expected dlo:friction:friction=0.3, '
                              'dlo:cutout:radius=0.01 or dlo:cutout:width=0.02,height=0.01'
                              ) from None

    def obstacle(self, name: str, pose: Pose) -> Obstacle:
        """Return what all shapes of an object are together."""
        assert self.whole is not None
        kind, values = self.whole
        if kind == 'ellipsoid':
            return Ellipsoid(pose, [values[key] for key in 'abc'], self.friction, name=name)
        return Sheet(pose, values['width'], values['height'], values['thickness'],
                     tuple(self.cutouts), self.friction, name=name)

    def mesh(self, triangles: Surface, pose: Pose) -> Obstacle:
        """Return the Mesh or Hull that an object is."""
        assert self.of_mesh is not None
        kind, values = self.of_mesh
        if kind == 'hull':
            return Hull(triangles.vertices, pose, self.friction)
        return Mesh(*triangles, pose, self.friction, bool(values['smooth']))


class _Words:
    """The words of a file, one after the other, and on which line they stand."""

    def __init__(self, path: Path) -> None:
        self._path, self._text, self._at = path, text_of(path, _LARGEST), 0
        self.within = ''  # the object that is being read
        self.read_as: dict[str, list[str]] = {}  # objects that are read as something else, by kind

    def fault(self, what: str) -> InvalidTask:
        """Return the error of what stands before the place that was reached."""
        line = self._text.count('\n', 0, max(self._at - 1, 0)) + 1
        there = f', object {self.within!r}' if self.within else ''
        return InvalidTask(f'{self._path}, line {line}{there}: {what}')

    def line(self) -> str:
        """Return the rest of the line."""
        end = self._text.find('\n', self._at)
        end = len(self._text) if end < 0 else end
        found, self._at = self._text[self._at:end], min(end + 1, len(self._text))
        return found

    def word(self, what: str) -> str:
        """Return the next word; `what` is expected."""
        match = _WORD.match(self._text, self._at)
        if match is None:
            self._at = len(self._text)
            raise self.fault(f'expected {what}, the file ends here: it is cut off')
        self._at = match.end()
        return match[1]

    def numbers(self, what: str, count: int) -> list[float]:
        """Return the next numbers."""
        found = []
        for _ in range(count):
            word = self.word(what)
            try:
                found.append(float(word))
            except ValueError:
                comma = ', with a decimal point' if ',' in word else ''
                raise self.fault(f'expected {what}: {count} numbers{comma}, got {shown(word)}'
                                 ) from None
        if not np.isfinite(found).all():
            raise self.fault(f'expected {what}: finite numbers, got {found[:8]}')
        return found

    def count(self, what: str, most: int) -> int:
        """Return a whole number."""
        number, = self.numbers(what, 1)
        if not (0 <= number <= most and number == int(number)):
            raise self.fault(f'expected {what}, got {number:g}')
        return int(number)

    def pose(self) -> Pose:
        """Return the next pose, a place and a quaternion x y z w."""
        numbers = self.numbers(f'a pose, {" ".join(_POSE)}', 7)
        try:
            return Pose(numbers[:3], numbers[3:])
        except InvalidTask as error:
            raise self.fault(str(error)) from None

    def has_object_poses(self) -> bool:
        """Whether objects have poses: the line below the first `*` has three numbers then."""
        found = re.compile(r'^\*[^\n]*\n\s*([^\n]*)', re.MULTILINE).search(self._text, self._at)
        return found is not None and len(found[1].split()) > 1


_WORD = re.compile(r'\s*(\S+)')


# ---- and back --------------------------------------------------------------------------------


def text_of_scene(obstacles: Iterable[Obstacle], name: str = 'scene') -> str:
    """Return the text of a MoveIt `.scene` with obstacles, which `read` reads as they were.

    Obstacles one after the other named X/0, X/1, ..., of the same friction, are one object X.
    """
    lines, waiting = [name], list(obstacles)
    while waiting:
        group = _group(waiting)
        del waiting[:len(group)]
        lines += _object(group[0]) if len(group) == 1 else _lines(
            group[0].name.removesuffix('/0'), Pose.identity(), [
                (text, _frame(one).compose(at)) for one in group
                for text, at in _SHAPES[type(one)](one)], _friction(group[0]))
    return '\n'.join([*lines, '.', ''])


def _group(waiting: Sequence[Obstacle]) -> Sequence[Obstacle]:
    """Return the obstacles at the beginning that are one object."""
    first = waiting[0]
    stem, count = first.name.removesuffix('/0'), 0
    if stem == first.name or '/' in stem:
        return waiting[:1]
    while count < len(waiting) and waiting[count].name == f'{stem}/{count}' and (
            isinstance(waiting[count], Box | Sphere | Capsule | Cylinder)) and (
            waiting[count].friction == first.friction):
        count += 1
    return waiting[:count] if count > 1 else waiting[:1]


def _object(one: Obstacle) -> list[str]:
    frames = _friction(one)
    if isinstance(one, Sheet):
        frames.append((_label('sheet', thickness=one.thickness, width=one.width,
                              height=one.height), Pose.identity()))
        for k, hole in enumerate(one.cutouts):
            sizes = {key: value for key in ('radius', 'width', 'height')
                     if (value := getattr(hole, key)) is not None}
            frames.append((_label(f'cutout{k}', **sizes),
                           one.pose.inverse().compose(hole.pose)))
    elif isinstance(one, Ellipsoid):
        frames.append((_label('ellipsoid', **dict(zip('abc', one.half_axes, strict=True))),
                       Pose.identity()))
    elif isinstance(one, Mesh):
        frames.append((_label('mesh', smooth=one.smooth), Pose.identity()))
    elif isinstance(one, Hull):
        frames.append((_label('hull'), Pose.identity()))
    return _lines(one.name, _frame(one), _SHAPES[type(one)](one), frames)


def _lines(name: str, pose: Pose, shapes: Iterable[tuple[str, Pose]],
           frames: Sequence[tuple[str, Pose]]) -> list[str]:
    shapes = list(shapes)
    lines = [f'* {name}', *_text(pose), str(len(shapes))]
    for text, at in shapes:
        lines += [text, *_text(at), '0 0 0 0']
    lines.append(str(len(frames)))
    for label, at in frames:
        lines += [label, *_text(at)]
    return lines


def _frame(one: Obstacle) -> Pose:
    """Return the pose of an object; what is round about a line stands in the world itself."""
    if isinstance(one, Plane):
        return Pose(one.point, NO_TURN)
    return Pose.identity() if isinstance(one, Sphere | Capsule | Cylinder) else one.pose


def _row(*numbers: float) -> str:
    return ' '.join(f'{float(number):.{_DIGITS}g}' for number in numbers)


def _text(pose: Pose) -> tuple[str, str]:
    return _row(*pose.position), _row(*pose.quaternion)


def _label(kind: str, **values: float) -> str:
    return f'{_OURS}{kind}:' + ','.join(f'{key}={float(value):.{_DIGITS}g}'
                                        for key, value in values.items())


def _friction(one: Obstacle) -> list[tuple[str, Pose]]:
    return [(_label('friction', friction=one.friction), Pose.identity())] if one.friction else []


def _bar(one: Capsule | Cylinder) -> tuple[str, Pose]:
    solid = one.solids[0]
    return f'cylinder\n{_row(one.radius, solid.size[2])}', solid.pose


def _mesh(vertices: Floats, faces: Ints) -> str:
    rows = [_row(*vertex) for vertex in vertices] + [' '.join(map(str, face)) for face in faces]
    return '\n'.join(['mesh', f'{len(vertices)} {len(faces)}', *rows])


def _of_hull(points: Floats) -> str:
    """Return the mesh of the hull of points, with all of them in their order."""
    corners, faces = hull('points', points)
    place = {tuple(point): k for k, point in reversed(list(enumerate(points.tolist())))}
    number = np.array([place[tuple(corner)] for corner in corners.tolist()])
    return _mesh(points, number[faces])


def _ball(half_axes: Floats) -> Floats:
    """Return corners (n, 3) of a polyhedron around an ellipsoid, m."""
    golden = 0.5 * (1 + 5**0.5)
    corners = np.array([np.roll((0.0, a, b * golden), k) for k in range(3)
                        for a in (1, -1) for b in (1, -1)])
    faces = hull('ball', corners)
    a, b, c = (faces.vertices[faces.faces[:, k]] for k in range(3))
    points = np.vstack([corners, a + b, b + c, c + a])
    points = np.unique(np.round(points / np.linalg.norm(points, axis=1)[:, None], 12), axis=0)
    _, faces_of = hull('ball', points)
    inner = np.linalg.norm(points[faces_of].mean(axis=1), axis=1).min()
    around: Floats = points / inner * half_axes
    return around


# (text, pose in the frame of the object) of each shape of an obstacle
_SHAPES: dict[type, Callable[[Any], list[tuple[str, Pose]]]] = {
    Box: lambda one: [(f'box\n{_row(*one.size)}', Pose.identity())],
    Sphere: lambda one: [(f'sphere\n{_row(one.radius)}', Pose(one.center, NO_TURN))],
    Cylinder: lambda one: [_bar(one)],
    Capsule: lambda one: [_bar(one), *((f'sphere\n{_row(one.radius)}', Pose(end, NO_TURN))
                                       for end in (one.start, one.end))],
    Plane: lambda one: [(f'plane\n{_row(*one.normal, 0.0)}', Pose.identity())],
    Ellipsoid: lambda one: [(_of_hull(_ball(one.half_axes)), Pose.identity())],
    Mesh: lambda one: [(_mesh(one.vertices, one.faces), Pose.identity())],
    Hull: lambda one: [(_of_hull(one.points), Pose.identity())],
    Sheet: lambda one: [(_of_hull(piece), Pose.identity()) for piece in pieces_of(one)]}
