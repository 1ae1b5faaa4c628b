# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks as YAML files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.files import text_of, writable
from dlo_planner.inverse.plain_tasks import classes_below, from_plain
from dlo_planner.inverse.task import Task
from dlo_planner.model.checks import instance, shown
from dlo_planner.model.pose import Pose
from dlo_planner.settings.guarded_yaml import load_yaml, yaml_of

_LONGEST = 100_000  # characters of a text: read within a second
# type -> field that says where -> whether it lists several
_PLACES = {'Thread': {'cutout': False}, 'Approach': {'cutout': False}, 'Insert': {'bore': False},
           'HoldContact': {'contact': False}, 'SlideContact': {'contact': False},
           'ThreadTwo': {'first': False, 'second': False}, 'ThreadSequence': {'cutouts': True}}


def task_to_yaml(task: Task) -> str:
    """Return a task as a YAML text: its class under `type`, each value in it likewise.

    Raises
    ------
    InvalidTask
        It is not a task, or holds a function, which cannot be written.
    """
    return yaml_of(instance('task', task, Task).to_dict())


def task_from_yaml(text: str, name: str = 'task') -> Task:
    """Return the task of a YAML text.

    Parameters
    ----------
    text : str
        As `task_to_yaml` writes it; what has a default may be left out.
    name : str, optional
        Its name in messages.

    Raises
    ------
    InvalidTask
        It is not YAML, or not a task.
    """
    content: Any = load_yaml(instance('text', text, str), name)
    return Task.from_dict(content)


def open_task(text: str, name: str = 'task') -> dict[str, Any]:
    """Return the content of a YAML text that describes a task, of which some may be left out."""
    if len(instance('text', text, str)) > _LONGEST:
        raise InvalidTask(f'{name} has {len(text)} characters: expected {_LONGEST} at most')
    content: Any = load_yaml(text, name)
    kind = content.get('type') if isinstance(content, dict) else None
    known = [one.__name__ for one in classes_below(Task) if not one.__name__.startswith('_')]
    if kind not in known:
        raise InvalidTask(f'{name}: expected {{type: ..., ...}} with a type of '
                          f'{", ".join(sorted(known))}, got {shown(content)}')
    missing = None in _poses_in(content, name)[:1]
    close_task(content, Pose((0, 0, 0), (0, 0, 0, 1)) if missing else None, name=name)
    return dict(content)


def close_task(content: Mapping[str, Any], pose: Pose | None = None, radius: float | None = None,
               name: str = 'task') -> Task:
    """Return the task of an open one."""
    if pose is not None and content.get('type') not in _PLACES:
        raise InvalidTask(f'{name}: a pose has no meaning for a {content.get("type")}: expected '
                          'none')
    moved, own = dict(content), _poses_in(content, name)
    first = next(filter(None, own), None)
    places = iter(own)

    def placed(place: Any, as_contact: bool) -> Any:
        here = next(places)
        if pose is not None:
            here = pose if here is None or first is None else pose.compose(
                first.inverse()).compose(here)
        if here is None:
            raise InvalidTask(f'{name}: expected a pose, of its own or asked for')
        if as_contact:
            return here
        cutout = {'type': 'CutOut', **(place or {}), 'pose': here}
        if not any(cutout.get(size) for size in ('radius', 'width', 'height')):
            cutout['radius'] = radius
        return cutout

    for field, several in _PLACES.get(str(content.get('type')), {}).items():
        given, contact = content.get(field), field == 'contact'
        moved[field] = [placed(one, contact) for one in given or ()] if several else placed(
            given, contact)
    task = from_plain(name, moved)
    assert isinstance(task, Task)  # its type is one
    return task


def _poses_in(content: Mapping[str, Any], name: str) -> list[Pose | None]:
    """Return the poses of an open task's places, None for one that is left out."""
    found: list[Pose | None] = []
    for field, several in _PLACES.get(str(content.get('type')), {}).items():
        given = content.get(field)
        if several and not (isinstance(given, list) and given):
            raise InvalidTask(f'{name}.{field} = {shown(given)}: expected a list of cut-outs')
        for place in given or () if several else [given]:
            if not isinstance(place, dict | None):
                raise InvalidTask(f'{name}.{field} = {shown(place)}: expected names and values')
            pose = place if field == 'contact' else (place or {}).get('pose')
            if pose is not None and not isinstance(pose := from_plain(f'{name}.{field}', pose),
                                                   Pose):
                raise InvalidTask(f'{name}.{field}: expected a pose, {{position, quaternion}}')
            found.append(pose)
    return found


def poses_of(task: Task) -> tuple[Pose, ...]:
    """Return the poses of a task's cut-outs, bore or contact; none for other tasks."""
    found: list[Pose] = []
    for field, several in _PLACES.get(type(task).__name__, {}).items():
        places = getattr(task, field)
        found += [one if isinstance(one, Pose) else one.pose
                  for one in (places if several else [places])]
    return tuple(found)


def read_task(path: Path) -> Task:
    """Return the task of a YAML file; raises InvalidTask as `task_from_yaml` does."""
    return task_from_yaml(text_of(path), str(path))


def write_task(path: Path, task: Task) -> None:
    """Write a task as a YAML file."""
    writable(path).write_text(task_to_yaml(task), encoding='utf-8')
