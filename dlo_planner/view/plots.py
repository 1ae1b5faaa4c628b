# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of shapes, plans and motions by matplotlib: in space, or from the side."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view.axes import Frame
from dlo_planner.view.colors import COLORINGS, GRAY, VERMILION, coloring, viridis
from dlo_planner.view.dlo_items import contact_items
from dlo_planner.view.item import Item
from dlo_planner.view.scene_items import path_items
from dlo_planner.view.stage import Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHAPES = 9         # of a plan or a motion that are drawn
_TICK = 0.04        # of the DLO's length: the direction of the gripper on its way
_TIP = (0.45, 0.45, 0.45)
OVER_TIME = ('time', *COLORINGS)


def plot_shape(shape: Shape, ax: 'Axes | Frame | None' = None, color: str | None = None,
               obstacles: Iterable[Obstacle] = ()) -> 'Figure':
    """Return the Figure of a Shape, see `Shape.plot`."""
    color = choice('color', 'curvature' if color is None else color, COLORINGS)
    stage = Stage.of((shape,), obstacles)
    painted = coloring(shape, color)
    frame = Frame.of(ax, stage.points)
    _show(frame, stage, [_line(0, shape, painted.colors), *contact_items(shape)], [shape.gripper])
    frame.color_bar(painted.top, painted.label)
    frame.title(_title(shape))
    return frame.figure


def plot_plan(plan: Plan, ax: 'Axes | Frame | None' = None, color: str | None = None,
              obstacles: Iterable[Obstacle] = ()) -> 'Figure':
    """Return the Figure of a Plan, see `Plan.plot`."""
    color = choice('color', 'time' if color is None else color, OVER_TIME)
    if not len(plan):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    stage = Stage.of(plan.shapes, obstacles, plan)
    frame = Frame.of(ax, stage.points)
    dlo, top, label = _over_time(plan, color)
    path = [replace(item, color=VERMILION) for item in path_items(
        plan.grippers, _TICK * stage.length) if len(plan) > 1]
    _show(frame, stage, dlo + path + contact_items(plan.shapes[-1]),
          [plan.grippers[0], plan.grippers[-1]])
    frame.color_bar(top, label)
    if path:
        frame.legend({'gripper': VERMILION})
    frame.title(_title(plan))
    return frame.figure


def plot_motion(motion: Motion, ax: 'Axes | Frame | None' = None, color: str | None = None,
                obstacles: Iterable[Obstacle] = ()) -> 'Figure':
    """Return the Figure of a Motion, see `Motion.plot`."""
    color = choice('color', 'time' if color is None else color, OVER_TIME)
    if not len(motion):
        raise InvalidTask(f'motion = {motion!r}: expected a Motion with an instant')
    stage = Stage.of(motion.shapes, obstacles)
    frame = Frame.of(ax, stage.points)
    dlo, top, label = _over_time(motion, color)
    tracks = {'gripper': (VERMILION, 0), 'free end': (_TIP, -1)}
    lines = [Item('way', k, 'line', tint, points=[shape.positions[node] for shape in motion.shapes])
             for k, (tint, node) in enumerate(tracks.values())]
    _show(frame, stage, dlo + lines, [motion.shapes[0].gripper, motion.shapes[-1].gripper])
    frame.color_bar(top, label)
    frame.legend({name: tint for name, (tint, _) in tracks.items()})
    frame.title(_title(motion))
    return frame.figure


def common_top(shapes: Iterable[Shape]) -> float:
    """Return the sharpest bend of all Shapes, 1/m, for one scale of colors."""
    return max(float(np.linalg.norm(shape.strains[:, 1:], axis=1).max()) for shape in shapes)


def _over_time(value: Plan | Motion, color: str) -> tuple[list[Item], float, str]:
    """Return the Items of some shapes of a Plan or Motion, and the top and label of their colors.

    Shapes are chosen at even times, first and last among them.
    """
    times = np.linspace(value.times[0], value.times[-1], _SHAPES)
    chosen = np.unique(np.abs(np.subtract.outer(value.times, times)).argmin(axis=0))
    if color == 'time':
        span = max(float(np.ptp(value.times)), 1e-12)
        tints = viridis((value.times[chosen] - value.times[0]) / span)
        return [Item('dlo', k, 'line', tint, points=value.shapes[k].positions)
                for k, tint in zip(chosen, tints, strict=True)], span, 'time [s]'
    shapes = [value.shapes[k] for k in chosen]
    painted = [coloring(shape, color, common_top(shapes)) for shape in shapes]
    return ([_line(index, shape, one.colors) for index, (shape, one) in enumerate(
        zip(shapes, painted, strict=True))], painted[0].top, painted[0].label)


def _line(index: int, shape: Shape, colors: Floats) -> Item:
    return Item('dlo', index, 'line', GRAY, points=shape.positions, colors=colors)


def _show(frame: Frame, stage: Stage, dlo: list[Item], grippers: Iterable[Pose]) -> None:
    """Draw the DLO among what is around it."""
    for index, pose in enumerate(grippers):
        dlo = dlo + stage.gripper(pose, index)
    stage.set(frame, dlo)


def _title(value: Shape | Plan | Motion) -> str:
    """Return the line that its repr says, in two if it is long."""
    kind, content = repr(value)[:-1].split('(', 1)
    parts, lines = content.split(', '), [f'{kind}:']
    for part in parts:
        if len(lines[-1]) + len(part) > 70:
            lines.append('')
        lines[-1] += f' {part},'
    return '\n'.join(lines).rstrip(',')
