# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shorthands of answers: to see them, to read them as a table, to hand them on as plain Python.

Answers are made far below the room that draws them, and need it only when they are looked at.
So the drawing is a plug-in, as in pandas: the module named by BACKEND, found by its name when a
method is called; so is the writing of files, by STORAGE.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, parts_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BACKEND = 'dlo_planner.view.backend'
STORAGE = 'dlo_planner.inverse.plain_tasks'


def plain(content: object) -> object:
    """Return a content as dicts, lists, numbers, strings, truth values and None.

    A Value becomes the dict of its public attributes, but for opaque ones, a Pose {'position',
    'quaternion'}, an array nested lists, an Enum its value. What is none of these (a function)
    becomes its repr.
    """
    if isinstance(content, Enum):
        return content.value
    if isinstance(content, np.ndarray | np.generic):
        return content.tolist()
    if isinstance(content, Pose):
        return {'position': content.position.tolist(), 'quaternion': content.quaternion.tolist()}
    if isinstance(content, Value):
        names = ([item.name for item in fields(content) if not item.metadata.get('opaque')]
                 if is_dataclass(content) else parts_of(content))
        return {name: plain(getattr(content, name)) for name in names if not name.startswith('_')}
    if isinstance(content, Mapping):
        return {str(key): plain(part) for key, part in content.items()}
    if isinstance(content, tuple | list):
        return [plain(part) for part in content]
    if content is None or isinstance(content, bool | int | float | str):
        return content
    return repr(content)


def _looks() -> Any:
    return import_module(BACKEND)


class Summarized(Value):
    """A value with a table, a picture in notebooks, and a form in plain Python."""

    def summary(self) -> str:
        """Return a table of what matters: one quantity a line, with its unit."""
        return str(_looks().summary(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the public attributes as dicts, lists, numbers and strings, SI units.

        A Pose is {'position', 'quaternion'}. What is not known is nan, which JSON has no word for.
        """
        return cast(dict[str, Any], plain(self))

    def _repr_html_(self) -> str:
        return str(_looks().html(self))


class Reported(Summarized):
    """A value that shows figures and limits."""

    def plot(self, *, ax: Axes | None = None) -> Figure:
        """Draw the figures beside what they may be; needs matplotlib (extra `figures`).

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in. If None, a new figure.

        Returns
        -------
        Figure
            Matplotlib Figure.

        Raises
        ------
        InvalidTask
            ax is not an Axes.
        MissingExtra
            Matplotlib is not installed.
        """
        return _looks().plot(self, ax=ax)


class Answer(Reported):
    """A value with figures that is kept in a file."""

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as JSON, all numbers exactly; each value in it names its class under `type`.

        Raises
        ------
        InvalidTask
            Nothing can be written there, or it holds a function.
        """
        import_module(STORAGE).write_value(path, self)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Return what was saved at `path`.

        Raises
        ------
        InvalidTask
            Not such a file; the message names it.
        """
        return cast(Self, import_module(STORAGE).read_value(path, cls))


class Pictured(Summarized):
    """A value that shows a DLO in space."""

    def plot(self, *, ax: Axes | None = None, color: str | None = None,
             obstacles: Iterable[Obstacle] = ()) -> Figure:
        """Draw it with what it passes and touches; needs matplotlib (extra `figures`).

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; with projection='3d' in space, else from the side (x and z). If None, a
            new figure in space, seen from where most of it is seen.
        color : str, optional
            'curvature', 'yield' or 'tension', see `dlo_planner.view.colors.coloring`; 'time', where
            there are times. If None, 'curvature' of a Shape, 'time' of a Plan or Motion.
        obstacles : iterable of obstacle, optional
            Obstacles drawn besides those that the shapes know.

        Returns
        -------
        Figure
            Matplotlib Figure; `figure.savefig('picture.png')` writes it.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        MissingExtra
            Matplotlib is not installed.
        """
        return _looks().plot(self, ax=ax, color=color, obstacles=obstacles)


class Filmed(Pictured):
    """A value that shows a DLO over time."""

    def animate(self, path: str | PathLike[str], *, color: str = 'curvature',
                seconds: float | None = None, obstacles: Iterable[Obstacle] = ()) -> Path:
        """Write a film of it: GIF, or MP4 where ffmpeg is installed; needs matplotlib.

        Parameters
        ----------
        path : str or PathLike
            Path of the film, ends with .gif or .mp4.
        color : str, optional
            'curvature', 'yield' or 'tension' (gray in motion, where it is not known).
        seconds : float, optional
            Duration of the film, at most 120. If None, that of the motion, if it is not longer.
        obstacles : iterable of obstacle, optional
            Obstacles drawn besides those that the shapes know.

        Returns
        -------
        Path
            Path of the film.

        Raises
        ------
        InvalidTask
            An argument makes no sense, or nothing can be written there.
        MissingExtra
            Matplotlib is not installed, or, for an MP4, ffmpeg.
        """
        return Path(_looks().animate(self, path, color=color, seconds=seconds,
                                     obstacles=obstacles))
