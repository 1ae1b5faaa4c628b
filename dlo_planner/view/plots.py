# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures and films of shapes, plans and motions."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import cycle
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct import grips
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask, MissingExtra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, shown
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view.colors import (
    COLORINGS,
    GRAY,
    ORANGE,
    VERMILION,
    Coloring,
    color_span,
    coloring,
    viridis,
)
from dlo_planner.view.mpl import Frame, Stage, draw, matplotlib
from dlo_planner.view.primitives import Primitive
from dlo_planner.view.scene import (
    contact_primitives,
    hold_primitives,
    path_primitives,
    plug_primitives,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHAPES = 9         # of a plan or a motion that are drawn
_TICK = 0.04        # of the DLO's length: the direction of the gripper on its way
_HELD = 0.1         # the same: an arrow or, five times smaller, a ball where it is held
_TIP = (0.45, 0.45, 0.45)
OVER_TIME = ('time', *COLORINGS)


def plot_shape(shape: Shape, ax: 'Axes | Frame | None' = None, color: str | None = None,
               obstacles: Iterable[Obstacle] = ()) -> 'Figure':
    """Return the Figure of a Shape, see `Shape.plot`."""
    color = choice('color', 'curvature' if color is None else color, COLORINGS)
    stage = Stage.of((shape,), obstacles)
    painted = coloring(shape, color)
    frame = Frame.of(ax, stage.points)
    _show(frame, stage, [_line(0, shape, painted.colors), *contact_primitives(shape),
                         *hold_primitives(shape)],
          [shape.gripper])
    frame.color_bar(painted.top, painted.label, painted.low)
    if shape.contacts:
        frame.legend(_forces(shape))
    frame.title(_title(shape))
    return frame.figure


def plot_over_time(value: Plan | Motion, ax: 'Axes | Frame | None' = None,
                   color: str | None = None, obstacles: Iterable[Obstacle] = ()) -> 'Figure':
    """Return the Figure of a Plan or a Motion, see `Plan.plot` and `Motion.plot`."""
    if not len(value):
        raise InvalidTask(f'{value!r} cannot be drawn: expected one with a shape')
    passes = np.ptp(value.times) > 0  # else nothing is later than anything
    color = choice('color', ('time' if passes else 'curvature') if color is None else color,
                   OVER_TIME)
    shapes = value.shapes
    stage = Stage.of(shapes, obstacles, value if isinstance(value, Plan) else None)
    frame = Frame.of(ax, stage.points)
    dlo, span, label = _over_time(value, color)
    marks: list[Primitive] = []
    if isinstance(value, Motion):
        tracks: dict[str, tuple[float, ...]] = {'gripper': VERMILION, 'free end': _TIP}
        lines = [Primitive('way', k, 'line', tint, points=[shape.positions[-k] for shape in shapes])
                 for k, tint in enumerate(tracks.values())]
    else:
        tracks = {'gripper': VERMILION} if len(value) > 1 else {}
        ways = {'gripper': value.grippers, **value.arms} if tracks else {}
        tracks = dict(zip(ways, cycle((VERMILION, _TIP, ORANGE)), strict=False))
        lines = [*(replace(one, color=tracks[name]) for k, (name, poses) in enumerate(ways.items())
                   for one in path_primitives(poses, _TICK * stage.length, k))]
        held = hold_primitives(shapes[-1], _HELD * stage.length)
        if held:
            tracks['held at the end'] = held[0].color
        marks = [*contact_primitives(shapes[-1]), *held, *plug_primitives(value)]
    _show(frame, stage, lines + dlo + marks, [shapes[0].gripper, shapes[-1].gripper])
    if passes or color != 'time':
        frame.color_bar(span[1], label, span[0])
    if isinstance(value, Plan) and not tracks:
        tracks = _forces(shapes[-1])
    if tracks:
        frame.legend(tracks)
    frame.title(_title(value))
    return frame.figure


def _forces(shape: Shape) -> dict[str, tuple[float, ...]]:
    """Return what a legend says of the arrows of contact forces: name -> color; {} of none."""
    if not shape.contacts:
        return {}
    most = max(float(np.linalg.norm(contact.vector)) for contact in shape.contacts)
    return {f'contact force, {most:.3g} N at most': VERMILION}


def _over_time(value: Plan | Motion,
               color: str) -> tuple[list[Primitive], tuple[float, float], str]:
    """Return shapes at even times, first and last among them; span and label of the colors."""
    times = np.linspace(value.times[0], value.times[-1], _SHAPES)
    chosen = np.unique(np.abs(np.subtract.outer(value.times, times)).argmin(axis=0))
    if color == 'time':
        span = max(float(np.ptp(value.times)), 1e-12)
        tints = viridis((value.times[chosen] - value.times[0]) / span)
        return [Primitive('dlo', k, 'line', tint, points=value.shapes[k].positions)
                for k, tint in zip(chosen, tints, strict=True)], (0.0, span), 'time [s]'
    shapes = [value.shapes[k] for k in chosen]
    span_ = color_span(shapes, color)
    painted = [coloring(shape, color, span_) for shape in shapes]
    return ([_line(index, shape, one.colors) for index, (shape, one) in enumerate(
        zip(shapes, painted, strict=True))], (painted[0].low, painted[0].top), painted[0].label)


def _line(index: int, shape: Shape, colors: Floats) -> Primitive:
    return Primitive('dlo', index, 'line', GRAY, points=shape.positions, colors=colors)


def _show(frame: Frame, stage: Stage, dlo: list[Primitive], grippers: Iterable[Pose]) -> None:
    """Draw the DLO among what is around it."""
    for index, pose in enumerate(grippers):
        dlo = dlo + stage.gripper(pose, index)
    stage.set(frame, dlo)


def _title(value: Shape | Plan | Motion) -> str:
    """Return the line that its repr says."""
    kind, content = repr(value)[:-1].split('(', 1)
    return f'{kind}: {content}'


# Pictures a second: a GIF counts hundredths of a second and drops what is left over.
_RATE = {'.gif': 20, '.mp4': 25}
_LONGEST = 120.0  # s
_DPI = 80


def film(value: Plan | Motion, path: str | PathLike[str], color: str = 'curvature',
         seconds: float | None = None, obstacles: Iterable[Obstacle] = ()) -> Path:
    """Write the film of a Plan or Motion and return its path, see `Plan.animate`."""
    path = checked_path(path)
    choice('color', color, COLORINGS)
    if not len(value):
        raise InvalidTask(f'{value!r} cannot be animated: expected one with a shape')
    span = float(np.ptp(value.times))
    seconds = min(span, _LONGEST) if seconds is None else number('seconds', seconds, above=0,
                                                                 maximum=_LONGEST)
    count = max(2, round(seconds * _RATE[path.suffix.lower()]))
    plan = value if isinstance(value, Plan) else None
    stage = Stage.of(value.shapes, obstacles, plan)
    frame = Frame.new(stage.points, managed=False)
    stage.set(frame)
    shown_span = color_span(value.shapes, color)
    painted = [coloring(shape, color, shown_span) for shape in value.shapes]
    frame.color_bar(painted[0].top, painted[0].label, painted[0].low)
    frame.title('0.00 s of 0.00 s')
    frame.settle()
    moving: list[Any] = []
    tips: list[Floats] = []

    def picture(index: int) -> None:
        time = value.times[0] + span * index / (count - 1)
        points, colors, gripper = between(value, painted, time)
        tips.append(points[-1])
        while moving:
            moving.pop().remove()
        moving.extend(draw(frame.axes, [
            Primitive('way', 0, 'line', _TIP, 0.6, np.array(tips)),
            Primitive('dlo', 0, 'line', GRAY, points=points, colors=colors),
            *stage.gripper(gripper)], frame.side))
        frame.title(f'{time:.2f} s of {value.times[-1]:.2f} s')

    return write_film(frame.figure, picture, count, path)


def between(value: Plan | Motion, painted: Sequence[Coloring],
            time: float) -> tuple[Floats, Floats, Pose]:
    """Return positions (n, 3) m, colors (n, 3) and the gripper's Pose at a time in s.

    Straight between two shapes, where both have the same nodes; else of the one before.
    """
    place = float(np.interp(time, value.times, np.arange(len(value))))
    k = int(place)
    share, after = place - k, min(k + 1, len(value) - 1)
    if len(value.shapes[k].s) != len(value.shapes[after].s):
        after = k
    one, other = value.shapes[k], value.shapes[after]
    return ((1 - share) * one.positions + share * other.positions,
            (1 - share) * painted[k].colors + share * painted[after].colors,
            grips.between(one.gripper, other.gripper, share))


def checked_path(path: str | PathLike[str]) -> Path:
    """Return the Path of a film; raise InvalidTask unless it ends with .gif or .mp4."""
    path = Path(instance('path', path, (str, PathLike)))
    if path.suffix.lower() not in _RATE:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file that ends with .gif or .mp4')
    return path


def write_film(figure: 'Figure', picture: Callable[[int], object], count: int, path: Path,
               rate: float | None = None) -> Path:
    """Write what a figure shows as a film, and return its path."""
    kind = path.suffix.lower()
    animation = matplotlib('.animation')
    if kind == '.mp4' and not animation.FFMpegWriter.isAvailable():
        raise MissingExtra(f'{path} needs the program ffmpeg, which is not installed: install it '
                           f'(apt install ffmpeg), or write {path.with_suffix(".gif")}')
    writer = animation.FFMpegWriter if kind == '.mp4' else animation.PillowWriter
    writer = writer(fps=_RATE[kind] if rate is None else rate)
    try:
        with writer.saving(figure, str(path), _DPI):
            for index in range(count):
                picture(index)
                writer.grab_frame()
    except OSError as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, '
                          f'{error}') from None
    return path
