# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a picture shows: the DLO, what was seen of it, frames, cut-outs, paths, obstacles."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import count

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import FIXTURE
from dlo_planner.model.obstacles import OBSTACLES, Capsule, Obstacle, Plane, Sheet, Solid
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, rooms_in_holes
from dlo_planner.view.colors import GRAY, ORANGE, SKY_BLUE, VERMILION, coloring, viridis
from dlo_planner.view.primitives import (
    Primitive,
    border,
    plate,
    rectangle,
    rim,
    room,
    rows_of_points,
    triangles,
)

_THIN, _LINE = 0.001, 0.002  # m: radius of a DLO whose radius is not known; width of a line
_AXIS = 0.05                 # m, length of axes, of a normal and of the gripper's direction
_AXIS_COLORS = ((0.9, 0.1, 0.1), (0.1, 0.8, 0.1), (0.15, 0.3, 1.0))
_ARROW = (0.004, 0.008, 0.01)  # m: shaft, head, length of the head
_LONGEST = 0.1               # m, arrow of the largest contact force
_CAPTION, _LETTER = 0.03, 0.02  # heights of letters: part of the DLO's length; m
_GREEN, _GHOST_COLOR, _WHITE = (0.0, 0.62, 0.45), (0.1, 0.3, 0.5), (1.0, 1.0, 1.0)
_GHOST, _BODY, _GLASS = 0.4, 0.5, 0.25  # alpha
_WIDE = 2.0                  # m, how much of a plane is drawn
_SAME = 1e-9                 # m


def shape_primitives(shape: Shape, color: str = 'curvature') -> list[Primitive]:
    """Return all that is seen of a Shape: the DLO, contact forces, axes of grips, and holds."""
    return [*dlo_primitives(shape, color), *contact_primitives(shape),
            *axes_primitives('gripper', shape.gripper), *hold_primitives(shape)]


def plan_primitives(plan: Plan, cutouts: Iterable[CutOut], ghosts: int = 6) -> list[Primitive]:
    """Return all that is seen of a Plan: cut-outs, the gripper's way, margins, some shapes."""
    cutouts = items('cutouts', cutouts, CutOut)
    paths = [plan.grippers, *plan.arms.values()]
    return [*cutout_primitives(cutouts),
            *(part for k, poses in enumerate(paths) for part in path_primitives(poses, arm=k)),
            *margin_primitives(plan, cutouts), *ghost_primitives(plan.shapes, ghosts)]


def dlo_primitives(shape: Shape, color: str = 'curvature') -> list[Primitive]:
    """Return the DLO as a line in the colors of its bend or yield, and a text that says which."""
    painted = coloring(shape, color)
    letter = _CAPTION * shape.s[-1]
    return [replace(_tube('dlo', 0, shape, GRAY), colors=painted.colors),
            _text('scale', 0, shape.gripper.position + (0.0, 0.0, 2 * letter), painted.caption,
                  letter)]


def contact_primitives(shape: Shape) -> list[Primitive]:
    """Return an arrow for each contact force on the DLO, and its size as a text in N.

    The largest one is 0.1 m long, the others in proportion.
    """
    instance('shape', shape, Shape)
    forces = np.array([contact.vector for contact in shape.contacts]).reshape(-1, 3)
    sizes = np.linalg.norm(forces, axis=1)
    drawn = []
    for index in np.flatnonzero(sizes > 0):
        at, arrow = shape.contacts[index].position, _LONGEST / sizes.max() * forces[index]
        drawn += [_arrow('contact', int(index), at, at + arrow, VERMILION),
                  _text('contact force', int(index), at + 1.2 * arrow, f'{sizes[index]:.3g} N',
                        _CAPTION * shape.s[-1])]
    return drawn


def hold_primitives(shape: Shape, length: float = _AXIS) -> list[Primitive]:
    """Return of each hold of a Shape an arrow along its axis, or a ball if it is a pin, and a text.

    The text says what holds there, and with what force, N. 'hold' and 'hold force', by the place.
    """
    length, drawn = number('length', length, above=0), []
    letter = _CAPTION * shape.s[-1]
    for index, (hold, wrench) in enumerate(zip(shape.holds, shape.wrenches, strict=True)):
        at = hold.pose.position
        if hold.grip in ('pinned', 'ring'):
            drawn.append(Primitive('hold', index, 'points', _GREEN, points=at[None],
                                   size=(0.2 * length,) * 3))
        else:
            drawn.append(_arrow('hold', index, at, at + length * hold.pose.direction, _GREEN))
        force = float(np.linalg.norm(wrench[:3]))
        name = 'far end' if hold.s is None and hold.by == FIXTURE else hold.by
        drawn.append(_text('hold force', index, at + (0.0, 0.0, 2 * letter),
                           f'{name} {force:.3g} N', letter))
    return drawn


def plug_primitives(plan: Plan) -> list[Primitive]:
    """Return the plug in the hand at the first and last waypoint of a Plan; none without one."""
    plug, drawn = instance('plan', plan, Plan).plug, list[Primitive]()
    for pose in () if plug is None else plan.plug_poses[::max(len(plan) - 1, 1)]:
        rear, front = (pose.position + x * pose.rotation[:, 0] for x in plug.ends)
        drawn += [_solid('plug', len(drawn) + k, solid)
                  for k, solid in enumerate(Capsule(rear, front, plug.radius).solids)]
    return drawn


def ghost_primitives(shapes: Iterable[Shape], number_shown: int = 6) -> list[Primitive]:
    """Return some of the Shapes of a plan, evenly chosen, thin and transparent."""
    shapes = items('shapes', shapes, Shape)
    number_shown = integer('number_shown', number_shown, minimum=0, maximum=1000)
    chosen = np.unique(np.linspace(0, len(shapes) - 1, number_shown).round().astype(int))
    return [_tube('ghost', index, shapes[k], _GHOST_COLOR, _GHOST, 0.5)
            for index, k in enumerate(chosen if len(shapes) else ())]


def estimate_primitives(shape: Shape, points: ArrayLike = ()) -> list[Primitive]:
    """Return the DLO as it is estimated to be, and its observed points (n, 3), m."""
    observed = rows_of_points('points', points)
    drawn = [_tube('estimate', 0, shape, ORANGE, 0.7)]
    if len(observed):
        drawn.append(Primitive('observed', 0, 'points', VERMILION, points=observed,
                               size=(0.005,) * 3))
    return drawn


def axes_primitives(group: str, pose: Pose, length: float = _AXIS) -> list[Primitive]:
    """Return the axes of a frame: x red, y green, z blue."""
    instance('pose', pose, Pose)
    length = number('length', length, above=0)
    return [_arrow(group, axis, pose.position, pose.position + length * pose.rotation[:, axis],
                   color) for axis, color in enumerate(_AXIS_COLORS)]


def cutout_primitives(cutouts: Iterable[CutOut], length: float = _AXIS) -> list[Primitive]:
    """Return the rims of CutOuts and their normals, 2 k and 2 k + 1 of 'cutout'."""
    length, drawn = number('length', length, above=0), []
    for index, cutout in enumerate(items('cutouts', cutouts, CutOut)):
        drawn += [_line('cutout', 2 * index, ORANGE, rim(cutout), cutout.pose),
                  _arrow('cutout', 2 * index + 1, cutout.center,
                         cutout.center + length * cutout.normal, ORANGE)]
    return drawn


def path_primitives(grippers: Iterable[Pose], length: float = _AXIS,
                    arm: int = 0) -> list[Primitive]:
    """Return the path of the gripper, 'trajectory' 0, and its directions on it, 1.

    Those of another `arm`, from 1 on: 'trajectory' 2 arm and the next.
    """
    length, grippers = number('length', length, above=0), items('grippers', grippers, Pose)
    points = np.array([pose.position for pose in grippers]).reshape(-1, 3)
    tips = points + length * np.array([pose.direction for pose in grippers]).reshape(-1, 3)
    ticks = np.stack([points, tips], axis=1).reshape(-1, 3)
    return [_line('trajectory', 2 * arm, _GREEN, points),
            Primitive('trajectory', 2 * arm + 1, 'segments', _GREEN, points=ticks,
                      size=(_LINE / 2, 0.0, 0.0))]


def margin_primitives(plan: Plan, cutouts: Iterable[CutOut]) -> list[Primitive]:
    """Return plates with the holes, their rims colored by the margin, and the margin as a text.

    The margin is the least distance between sheet and DLO at all waypoints in the hole, of all
    parts of the DLO: an oblique one has less than at the rim alone. Dark: none, bright: as much as
    a DLO straight through the middle would have; beyond the limit (the DLO in the sheet) ALERT.
    """
    radius = _radius(instance('plan', plan, Plan).shapes[0]) if len(plan) else 0.0
    drawn, rooms = [], rooms_in_holes(plan)
    for index, cutout in enumerate(items('cutouts', cutouts, CutOut)):
        most = room(cutout)
        if most is None:
            continue
        drawn.append(Primitive('plate', index, 'triangles', GRAY, _GLASS, plate(cutout),
                               pose=cutout.pose))
        margin = rooms[:, index].min(initial=np.inf) if index < rooms.shape[1] else np.inf
        if not np.isfinite(margin):
            continue
        fraction = np.clip(margin / max(most - radius, 1e-12), 0.0, 1.0) if margin >= 0 else 2.0
        points, color = rim(cutout), viridis([fraction])
        below = cutout.pose.position - (0.0, 0.0, np.abs(points).max() + 3 * _LETTER)
        drawn += [replace(_line('margin', index, color[0], points, cutout.pose, 2 * _LINE),
                          colors=np.repeat(color, len(points), axis=0)),
                  _text('rim margin', index, below, f'rim margin {1e3 * margin:.2g} mm', _LETTER)]
    return drawn


def obstacle_primitives(obstacles: Iterable[Obstacle]) -> list[Primitive]:
    """Return obstacles half transparent, 'obstacle' k; its further solids are 'cap's."""
    drawn: list[Primitive] = []
    caps = count()  # no two of one group have the same number: markers would replace each other
    for index, obstacle in enumerate(items('obstacles', obstacles, OBSTACLES)):
        if isinstance(obstacle, Plane):
            drawn.append(_pane('obstacle', index, rectangle(_WIDE, _WIDE),
                               Pose.looking_along(obstacle.point, obstacle.normal)))
        elif isinstance(obstacle, Sheet) and not obstacle.cutouts:
            drawn.append(_pane('obstacle', index, rectangle(obstacle.width, obstacle.height),
                               obstacle.pose))
        elif isinstance(obstacle, Sheet):
            edge = border(obstacle.width, obstacle.height)
            drawn += [_line('obstacle', index, GRAY, edge, obstacle.pose),
                      *(_pane(f'sheet {index}', k, plate(cutout), cutout.pose)
                        for k, cutout in enumerate(obstacle.cutouts))]
        else:
            body, *ends = obstacle.solids
            drawn += [_solid('obstacle', index, body),
                      *(_solid('cap', next(caps), end) for end in ends)]
    return drawn


def cutouts_of(plan: Plan) -> list[CutOut]:
    """Return the CutOuts that a Plan passes, as far as it tells: those without a size have none."""
    if not len(plan):
        return []
    sized = [cutout for sheet, _ in plan.sheets for cutout in sheet.cutouts]
    return [next((cutout for cutout in sized if np.abs(cutout.center - center).max() < _SAME),
                 CutOut(Pose.looking_along(center, normal)))
            for center, _, normal in plan.via_points[-1] if normal is not None]


def _radius(shape: Shape) -> float:
    """Return the radius in m of a DLO; 0 where it has none, it varies, or its rod is not known."""
    radius = None if shape.rod is None else shape.rod.radius
    return radius if isinstance(radius, float) else 0.0


def _tube(group: str, index: int, shape: Shape, color: tuple[float, float, float],
          alpha: float = 1.0, part: float = 1.0) -> Primitive:
    """Return the DLO as a line, as thick as it is, or `part` of that."""
    instance('shape', shape, Shape)
    return Primitive(group, index, 'line', color, alpha, shape.positions,
                     size=(2 * part * (_radius(shape) or _THIN), 0.0, 0.0))


def _line(group: str, index: int, color: ArrayLike, points: Floats,
          pose: Pose = Pose.identity(), width: float = _LINE) -> Primitive:  # noqa: B008 - frozen
    return Primitive(group, index, 'line', color, points=points, pose=pose, size=(width, 0.0, 0.0))


def _arrow(group: str, index: int, start: Floats, end: Floats,
           color: tuple[float, float, float]) -> Primitive:
    return Primitive(group, index, 'arrow', color, points=(start, end), size=_ARROW)


def _text(group: str, index: int, position: Floats, text: str, height: float) -> Primitive:
    return Primitive(group, index, 'text', _WHITE, text=text, size=(0.0, 0.0, height),
                     pose=Pose(position, (0.0, 0.0, 0.0, 1.0)))


def _pane(group: str, index: int, triangles: Floats, pose: Pose) -> Primitive:
    return Primitive(group, index, 'triangles', SKY_BLUE, _GLASS, triangles, pose=pose)


def _solid(group: str, index: int, solid: Solid) -> Primitive:
    if solid.surface is not None:
        return Primitive(group, index, 'triangles', GRAY, _BODY, triangles(solid.surface),
                         pose=solid.pose)
    return Primitive(group, index, solid.kind, GRAY, _BODY, pose=solid.pose, size=solid.size)
