# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles in YAML: each by its class and its fields, or the file that has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.plain_tasks import FieldKind, from_plain, to_plain
from dlo_planner.model.checks import choice, did_you_mean, flag, known_keys, number, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Mesh, Obstacle
from dlo_planner.model.plain_poses import pose_of
from dlo_planner.model.triangles import UNITS
from dlo_planner.scene.content import Asked, Content, moved, moved_cutout
from dlo_planner.settings.yaml_files import read_yaml, yaml_of

_KINDS = {one.__name__.lower(): one for one in OBSTACLES}
_OF_FILE = ('path', 'unit', 'pose', 'friction', 'joints', 'hulls', 'name')
Reader = Callable[[Path, Asked], Content]  # of any file


def read(path: Path, asked: Asked, other: Reader) -> Content:
    """Return what a YAML file says, in m; `other` reads the files that it names."""
    found = read_yaml(path)
    content = Content()
    if isinstance(found, dict) and ('obstacles' in found or 'cutouts' in found):
        known_keys(str(path), found, ('obstacles', 'cutouts'))
        holes = found.get('cutouts') or []
        if not isinstance(holes, list):
            raise InvalidTask(f'{path}: cutouts = {shown(holes)}: expected a list')
        content.cutouts += [cast(CutOut, from_plain(f'{path}: cutouts[{k}]', one,
                                                    expected=FieldKind(CutOut, False)))
                            for k, one in enumerate(holes)]
        found = found.get('obstacles') or []
    if isinstance(found, dict):
        found = [found]
    if not isinstance(found, list):
        raise InvalidTask(f'{path}: expected a list of obstacles, as "- sphere: {{center: [0, 0, '
                          '1], radius: 0.1}"')
    for k, one in enumerate(found):
        name = f'{path}[{k}]'
        if isinstance(one, dict) and list(one) == ['file']:
            part = _of_file(name, one['file'], path, asked, other)
            content.obstacles += part.obstacles
            content.cutouts += part.cutouts
            content.notes += part.notes
        else:
            # what is written here is in the unit that was asked for; files know their own
            content.obstacles.append(moved(_obstacle(name, one, asked.friction, path.parent),
                                           scale=UNITS[asked.unit or 'm']))
    return content


def _of_file(name: str, said: object, path: Path, asked: Asked, other: Reader) -> Content:
    """Return what a file in a list says, where it is put: {path, unit, pose, friction, ...}."""
    given = {'path': said} if isinstance(said, str) else said
    if not isinstance(given, Mapping) or not isinstance(given.get('path'), str):
        raise InvalidTask(f'{name}.file = {shown(said)}: expected a path, or path: with some of '
                          f'{", ".join(_OF_FILE[1:])}')
    known_keys(f'{name}.file', given, _OF_FILE)
    unit = given.get('unit')
    if unit is not None:
        choice(f'{name}.file.unit', unit, UNITS)
    joints = given.get('joints') or {}
    if not isinstance(joints, Mapping):
        raise InvalidTask(f'{name}.file.joints = {shown(joints)}: expected joints with their '
                          'values, as {finger: 0.02}')
    content = other(path.parent / given['path'], Asked(
        unit, number(f'{name}.file.friction', given.get('friction', asked.friction), minimum=0),
        joints, flag(f'{name}.file.hulls', given.get('hulls', asked.hulls))))
    if given.get('pose') is not None:
        pose = pose_of(f'{name}.file.pose', given['pose'])
        content = Content([moved(one, pose) for one in content.obstacles],
                          [moved_cutout(one, pose) for one in content.cutouts], content.notes)
    called = given.get('name')
    if called is not None:
        alone = len(content.obstacles) == 1
        content.obstacles = [replace(one, name=called if alone else f'{called}/{one.name or k}')
                             for k, one in enumerate(content.obstacles)]
    return content


def _obstacle(name: str, content: object, friction: float, folder: Path) -> Obstacle:
    """Return what {kind: {field: value}} says: the class in small letters, its fields."""
    kind, given = next(iter(content.items())) if (
        isinstance(content, dict) and len(content) == 1) else ('', None)
    if kind not in _KINDS or not isinstance(given, dict):
        raise InvalidTask(f'{name} = {shown(content)}: expected one of file, {", ".join(_KINDS)}, '
                          f'with its values{did_you_mean(kind, _KINDS)}')
    cls = _KINDS[kind]
    if cls is Mesh and 'path' in given:
        return _mesh_of(f'{name}.{kind}', given, friction, folder)
    if given.get('type', cls.__name__) != cls.__name__:
        raise InvalidTask(f'{name}.{kind}.type = {shown(given["type"])}: expected none, its name '
                          'says it')
    return cast(Obstacle, from_plain(f'{name}.{kind}', {'friction': friction, **given},
                                     expected=FieldKind(cls, False)))


def _mesh_of(name: str, given: Mapping[str, Any], friction: float, folder: Path) -> Mesh:
    """Return the one Mesh that all triangles of a file are: {path, unit, pose, smooth, ...}."""
    known_keys(name, given, ('path', 'unit', 'pose', 'friction', 'smooth', 'name'))
    more = {'friction': friction, **given}
    called = more.pop('name', '')
    if not isinstance(more['path'], str):
        raise InvalidTask(f'{name}.path = {shown(more["path"])}: expected the name of a file')
    more['path'] = folder / more['path']
    if 'pose' in more:
        more['pose'] = pose_of(f'{name}.pose', more['pose'])
    try:
        return replace(Mesh.read(**more), name=called)
    except InvalidTask as error:
        raise InvalidTask(f'{name}: {error}') from None


def text_of_list(obstacles: tuple[Obstacle, ...], cutouts: tuple[CutOut, ...]) -> str:
    """Return the YAML text that `read` reads as the same."""
    listed: list[dict[str, Any]] = []
    for one in obstacles:
        plain = to_plain(one)
        listed.append({type(one).__name__.lower(): {
            item.name: plain[item.name] for item in fields(one)}})
    content = {'obstacles': listed, 'cutouts': [to_plain(one) for one in cutouts]}
    return yaml_of({key: part for key, part in content.items() if part})
