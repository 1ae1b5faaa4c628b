# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks as YAML, and their plans as the parameters ask for them."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.execute.loop_motions import way_onto
from dlo_planner.inverse.plain_tasks import (
    classes_below,
    from_plain,
    judge_keys,
    value_fields,
)
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.inverse.tasks.thread import Thread, trim_to_clearance
from dlo_planner.inverse.tasks.thread_sequence import cutouts_of
from dlo_planner.model.checks import did_you_mean, instance, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.files import text_of, writable
from dlo_planner.model.plain_poses import pose_of
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.progress import OnProgress, Progress, interrupted_by
from dlo_planner.settings.build import Values, limits_of, tolerance_of
from dlo_planner.settings.yaml_files import load_yaml, yaml_of

_LONGEST = 100_000  # characters of a text: read within a second


def task_to_yaml(task: Task) -> str:
    """Return a task as a YAML text: its class under `type`, each value in it likewise.

    Raises
    ------
    InvalidTask
        It is not a task, or holds a function, which cannot be written.
    """
    return yaml_of(instance('task', task, Task).to_dict())


def task_from_yaml(text: str, name: str = 'task') -> Task:
    """Return the task of a YAML text, which the node and the terminal understand alike.

    Parameters
    ----------
    text : str
        As `task_to_yaml` writes it; what has a default may be left out, and `type` where values of
        one class alone can stand, as of a cut-out.
    name : str, optional
        Its name in messages.

    Raises
    ------
    InvalidTask
        It is not YAML, or not a task.
    """
    return close_task(_content(instance('text', text, str), name), name=name)


def open_task(text: str, name: str = 'task') -> dict[str, Any]:
    """Return the content of a YAML text that describes a task, of which some may be left out."""
    if len(instance('text', text, str)) > _LONGEST:
        raise InvalidTask(f'{name} has {len(text)} characters: expected {_LONGEST} at most')
    content = _content(text, name)
    missing = None in _poses_in(content, name)[:1]
    close_task(content, Pose((0, 0, 0), (0, 0, 0, 1)) if missing else None, name=name)
    return content


def _content(text: str, name: str) -> dict[str, Any]:
    """Return the content of a YAML text that names a class of tasks, and no key that it has not."""
    content: Any = load_yaml(text, name)
    kind = content.get('type') if isinstance(content, dict) else None
    known = {one.__name__: one for one in classes_below(Task) if not one.__name__.startswith('_')}
    if not isinstance(kind, str) or kind not in known:
        raise InvalidTask(f'{name}: expected {{type: ..., ...}} with a type of '
                          f'{", ".join(sorted(known))}, got {shown(content)}'
                          f'{did_you_mean(kind, known)}')
    judge_keys(name, content, known[kind])
    return dict(content)


def _places(kind: object) -> list[tuple[str, bool, bool]]:
    """Return the fields of a class of tasks that say where, by their types.

    And of each whether it lists several, and whether those are poses, no cut-outs.
    """
    return [(name, several, held is Pose)
            for task in classes_below(Task) if task.__name__ == kind
            for name, (held, several) in value_fields(task).items() if held in (Pose, CutOut)]


def _given_places(content: Mapping[str, Any]) -> list[tuple[str, bool, bool]]:
    """Return those of an open task, without what it may leave out and does."""
    optional = {item.name for task in classes_below(Task) if task.__name__ == content.get('type')
                for item in fields(cast('Any', task)) if item.default is not MISSING}
    return [one for one in _places(content.get('type'))
            if one[0] not in optional or content.get(one[0])]


def close_task(content: Mapping[str, Any], pose: Pose | None = None, radius: float | None = None,
               name: str = 'task') -> Task:
    """Return the task of an open one."""
    if pose is not None and not _places(content.get('type')):
        raise InvalidTask(f'{name}: a pose has no meaning for a {content.get("type")}: expected '
                          'none')
    moved, own = dict(content), _poses_in(content, name)
    first = next(filter(None, own), None)
    places = iter(own)

    def placed(place: Any, bare: bool) -> Any:
        here = next(places)
        if pose is not None:
            here = pose if here is None or first is None else pose.compose(
                first.inverse()).compose(here)
        if here is None:
            wanted = ' or '.join(field for field, _, _ in _given_places(content))
            raise InvalidTask(f'{name}: expected a pose, by {wanted} or with the request')
        if bare:
            return here
        cutout = {**(place or {}), 'pose': here}
        if all(cutout.get(size) is None for size in ('radius', 'width', 'height')):  # 0 is a size
            cutout['radius'] = radius
        return cutout

    for field, several, bare in _given_places(content):
        given = content.get(field)
        moved[field] = [placed(one, bare) for one in given or ()] if several else placed(
            given, bare)
    task = from_plain(name, moved)
    assert isinstance(task, Task)  # its type is one
    return task


def _poses_in(content: Mapping[str, Any], name: str) -> list[Pose | None]:
    """Return the poses of an open task's places, None for one that is left out."""
    found: list[Pose | None] = []
    for field, several, bare in _given_places(content):
        given = content.get(field)
        if several and not (isinstance(given, list) and given):
            raise InvalidTask(f'{name}.{field} = {shown(given)}: expected a list of them')
        for place in given or () if several else [given]:
            if not bare and not isinstance(place, dict | None):
                raise InvalidTask(f'{name}.{field} = {shown(place)}: expected names and values')
            pose, said = (place, '') if bare else ((place or {}).get('pose'), '.pose')
            found.append(None if pose is None else pose_of(f'{name}.{field}{said}', pose))
    return found


def poses_of(task: Task) -> tuple[Pose, ...]:
    """Return the poses of a task's cut-outs, bore or contact, or its own; none for other tasks."""
    found: list[Pose] = []
    for field, several, _ in _places(type(task).__name__):
        places = getattr(task, field)
        found += [one if isinstance(one, Pose) else one.pose
                  for one in (places if several else [places]) if one is not None]
    return tuple(found)


def read_task(path: Path, radius: float | None = None) -> Task:
    """Return the task of a YAML file.

    Parameters
    ----------
    path : Path
    radius : float, optional
        Radius of round cut-outs that do not say theirs, m. If None, they have none.

    Raises
    ------
    InvalidTask
        As of `task_from_yaml`; the message names the file.
    """
    name = str(path)
    return close_task(_content(text_of(path), name), radius=radius, name=name)


def write_task(path: Path, task: Task) -> None:
    """Write a task as a YAML file."""
    writable(path).write_text(task_to_yaml(task), encoding='utf-8')


STANDOFF = 0.05       # of the length, where none is given


def plan_task(inverse: InverseSimulator, task: Task, values: Values, *,
              start: Pose | None = None, initial: Shape | None = None, miss: float | None = None,
              progress: OnProgress = None, deadline: float | None = None) -> Plan:
    """Return the Plan of a task, where parameter values say what the task leaves open.

    `start` and `initial` are where gripper and DLO are now, where that is known. With a standoff, a
    threading begins there, and what touches comes straight down from there. A plan of one pose
    begins there, too. `deadline`: of all of it, s.
    """
    with interrupted_by(Progress(deadline=deadline).check):
        return _plan(inverse, task, values, start, initial, miss, progress)


def _plan(inverse: InverseSimulator, task: Task, values: Values, start: Pose | None,
          initial: Shape | None, miss: float | None, progress: OnProgress) -> Plan:
    length, standoff = inverse.simulator.rod.length, values['threading.standoff']
    task = held_as_stated(task, values['rod.grasped_at'])
    task = _with_depths(task, values, length - (task.held_inside or 0.0))
    most = values['threading.max_misalignment']
    if isinstance(task, Thread) and task.max_misalignment is None and most >= 0:
        task = replace(task, max_misalignment=most)
    options: dict[str, Any] = {'progress': progress, 'requirements': replace(
        inverse.requirements, limits=limits_of(values), tolerance=miss,
        margin=values['threading.margin'] or None)}
    if task.outwards is not None and standoff and start is not None:
        return inverse.check(concatenate(*way_onto(
            inverse, task, start, standoff if standoff > 0 else STANDOFF * length,
            values['contacts.tolerance'], **options)))
    plan = inverse.plan(task, start=start, initial=initial if task.takes_initial and (
        not task.threads) else None, **options)
    if len(plan) == 1 and start is not None:
        first = initial or inverse.simulator.track([start])[0]
        plan = inverse.plan(_From(first, plan, task.touches), start=start, **options)
    elif task.threads:
        hole, clearance = cutouts_of(task)[0], values['threading.gripper_clearance']
        if clearance and getattr(task, 'gripper_clearance', None) is None:
            plan = inverse.check(trim_to_clearance(plan, hole, clearance, True))
        if standoff and start is not None:
            way = inverse.plan(Approach(hole, plan.shapes[0], standoff if standoff > 0 else None,
                                        plan, tolerance_of(values)),
                               start=start, initial=initial, **options)
            plan = inverse.check(concatenate(way, plan))
    if miss is not None and not plan.position_error.max() <= miss:
        worst = int(plan.position_error.argmax())
        raise Infeasible(f'waypoint {worst} misses its place by {plan.position_error[worst]:.3g} '
                         f'm: expected {miss:g} m at most', worst, 'tolerance',
                         float(plan.position_error[worst]) - miss, plan)
    return plan


def held_as_stated(task: Task, at: float) -> Task:
    """Return a task of a DLO that the gripper holds at `at`, m from its beginning, if not at 0.

    Raises
    ------
    InvalidTask
        Such a task is not planned, or says that it is held elsewhere.
    """
    if not at:
        return task
    if not task.grasps_inside:
        raise InvalidTask(f'parameter rod.grasped_at = {at:g}: expected 0 for the plan of a '
                          f'{type(task).__name__}: of a DLO that is grasped inside, a Thread alone '
                          'is planned')
    known, own = task.held_inside, cast('Any', task)  # a dataclass that has it
    if known not in (None, at):
        raise InvalidTask(f'hold_at = {known:g}: expected none, or rod.grasped_at = {at:g}, where '
                          'the gripper holds the DLO')
    held: Task = replace(own, hold_at=at)
    return held


def _with_depths(task: Task, values: Values, length: float) -> Task:
    """Return a task with the depths of the parameters on what is `length` m long before the hole.

    If it has none of its own.
    """
    own: Any = task  # a dataclass that has depths, if any
    if task.deepest is None or own.depths is not None:
        return task
    most = min(values['threading.deepest'], task.deepest)
    complete: Task = replace(own, depths=np.linspace(0.0, most * length,
                                                     values['threading.waypoints']))
    return complete


@dataclass(frozen=True, eq=False, repr=False)
class _From(Task):
    """Go from a Shape to the one pose of a plan, straight."""

    first: Shape
    to: Plan
    touching: bool

    @property
    def touches(self) -> bool:  # type: ignore[override]  # as those of the plan do
        """Whether the plan means to touch obstacles."""
        return self.touching

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan of two poses."""
        plan, builder = self.to, context.builder([0.0, *self.to.depths])
        builder.add(Waypoint(self.first))
        builder.add(Waypoint(plan.shapes[0], float(plan.misalignment[0]),
                             float(plan.position_error[0]), plan.via_points[0]))
        return builder.finished()
