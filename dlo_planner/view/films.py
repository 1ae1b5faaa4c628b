# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Films of plans and motions, as GIF (Pillow) or MP4 (ffmpeg)."""

from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.motion import Motion
from dlo_planner.errors import InvalidTask, MissingExtra
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, shown
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view.axes import Frame
from dlo_planner.view.colors import COLORINGS, GRAY, Coloring, coloring
from dlo_planner.view.drawing import draw
from dlo_planner.view.item import Item
from dlo_planner.view.plots import common_top
from dlo_planner.view.stage import Stage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RATE = {'.gif': 15, '.mp4': 25}  # pictures a second
_LONGEST, _DEFAULT = 120.0, 10.0  # s
_DPI = 80
_TIP = (0.45, 0.45, 0.45)


def film(value: Plan | Motion, path: str | PathLike[str], color: str = 'curvature',
         seconds: float | None = None, obstacles: Iterable[Obstacle] = ()) -> Path:
    """Write the film of a Plan or Motion and return its path, see `Plan.animate`."""
    path = checked_path(path)
    choice('color', color, COLORINGS)
    if not len(value):
        raise InvalidTask(f'{value!r} cannot be animated: expected one with a shape')
    span = float(np.ptp(value.times))
    seconds = min(span, _DEFAULT) if seconds is None else number('seconds', seconds, above=0,
                                                                 maximum=_LONGEST)
    count = max(2, round(seconds * _RATE[path.suffix.lower()]))
    plan = value if isinstance(value, Plan) else None
    stage = Stage.of(value.shapes, obstacles, plan)
    frame = Frame.new(stage.points, managed=False)
    stage.set(frame)
    top = common_top(value.shapes)
    painted = [coloring(shape, color, top) for shape in value.shapes]
    frame.color_bar(painted[0].top, painted[0].label)
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
            Item('way', 0, 'line', _TIP, 0.6, np.array(tips)),
            Item('dlo', 0, 'line', GRAY, points=points, colors=colors), *stage.gripper(gripper)],
            frame.side))
        frame.title(f'{time:.2f} s of {value.times[-1]:.2f} s')

    return write_film(frame.figure, picture, count, path)


def between(value: Plan | Motion, painted: Sequence[Coloring],
            time: float) -> tuple[Floats, Floats, Pose]:
    """Return positions (n, 3) m, colors (n, 3) and the gripper's Pose at a time in s.

    Straight between two shapes, where both have the same nodes; else of the one before.
    """
    times = value.times
    k = int(np.clip(np.searchsorted(times, time, side='right') - 1, 0, max(len(value) - 2, 0)))
    after = min(k + 1, len(value) - 1)
    span = times[after] - times[k]
    share = float(np.clip((time - times[k]) / span, 0.0, 1.0)) if span > 0 else 1.0
    if len(value.shapes[k].s) != len(value.shapes[after].s):
        k = after = k if share < 1 else after
    one, other = value.shapes[k], value.shapes[after]
    turn = Rotation.from_matrix(other.gripper.rotation @ one.gripper.rotation.T).as_rotvec()
    gripper = Pose.from_rotation(
        (1 - share) * one.gripper.position + share * other.gripper.position,
        Rotation.from_rotvec(share * turn).as_matrix() @ one.gripper.rotation)
    return ((1 - share) * one.positions + share * other.positions,
            (1 - share) * painted[k].colors + share * painted[after].colors, gripper)


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
    animation = extra('matplotlib.animation', 'figures', 'films')
    if kind == '.mp4' and not animation.FFMpegWriter.isAvailable():
        raise MissingExtra(f'{path} needs the program ffmpeg, which is not installed: install it '
                           f'(apt install ffmpeg), or write {path.with_suffix(".gif")}')
    writer = animation.FFMpegWriter if kind == '.mp4' else animation.PillowWriter
    writer = writer(fps=rate or _RATE[kind])
    try:
        with writer.saving(figure, str(path), _DPI):
            for index in range(count):
                picture(index)
                writer.grab_frame()
    except OSError as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, '
                          f'{error}') from None
    return path
