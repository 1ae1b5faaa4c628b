# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a DLO: itself, what it touches, what was seen of it; and of frames."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, number
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.view.colors import GRAY, ORANGE, VERMILION, coloring
from dlo_planner.view.item import Item, rows_of_points

_THIN = 0.001     # m, radius of a DLO whose radius is not known
_AXIS = 0.05      # m, length of drawn axes
_AXIS_COLORS = ((0.9, 0.1, 0.1), (0.1, 0.8, 0.1), (0.15, 0.3, 1.0))
_LONGEST = 0.1    # m, arrow of the largest contact force
_GHOST = 0.4      # alpha
_GHOST_COLOR = (0.1, 0.3, 0.5)
_ARROW = (0.004, 0.008, 0.01)  # m: shaft, head, length of the head
_LETTER = 0.03    # of the DLO's length


def drawn_radius(rod: Rod) -> float | None:
    """Return the radius in m with which a Rod is drawn; None where it has none or it varies."""
    return rod.radius if isinstance(rod.radius, float) else None


def dlo_items(shape: Shape, radius: float | None = None, color: str = 'curvature') -> list[Item]:
    """Return the DLO as a line in the colors of its bend or yield, and a text that says which."""
    painted = coloring(shape, color)
    above = shape.gripper.position + (0.0, 0.0, 2 * _LETTER * shape.s[-1])
    return [replace(_tube('dlo', 0, shape, radius, GRAY), colors=painted.colors),
            _text('scale', 0, above, painted.caption, shape)]


def contact_items(shape: Shape) -> list[Item]:
    """Return an arrow for each contact force on the DLO, and its size as a text in N.

    The largest one is 0.1 m long, the others in proportion.
    """
    instance('shape', shape, Shape)
    forces = np.array([contact.vector for contact in shape.contacts]).reshape(-1, 3)
    sizes = np.linalg.norm(forces, axis=1)
    drawn = []
    for index, contact in enumerate(shape.contacts):
        if not sizes[index] > 0:
            continue
        arrow = _LONGEST / sizes.max() * forces[index]
        drawn += [_arrow('contact', index, contact.position, contact.position + arrow, VERMILION),
                  _text('contact force', index, contact.position + 1.2 * arrow,
                        f'{sizes[index]:.3g} N', shape)]
    return drawn


def ghost_items(shapes: Iterable[Shape], radius: float | None = None,
                number_shown: int = 6) -> list[Item]:
    """Return some of the Shapes of a plan, evenly chosen, thin and transparent."""
    shapes = items('shapes', shapes, Shape)
    number_shown = integer('number_shown', number_shown, minimum=0, maximum=1000)
    chosen = np.unique(np.linspace(0, len(shapes) - 1, number_shown).round().astype(int))
    thin = 0.5 * (_THIN if radius is None else number('radius', radius, minimum=0))
    return [_tube('ghost', index, shapes[k], thin, _GHOST_COLOR, alpha=_GHOST)
            for index, k in enumerate(chosen if len(shapes) else ())]


def estimate_items(shape: Shape, radius: float | None = None, points: ArrayLike = ()) -> list[Item]:
    """Return the DLO as it is estimated to be, and its observed points (n, 3), m."""
    observed = rows_of_points('points', points)
    drawn = [_tube('estimate', 0, shape, radius, ORANGE, alpha=0.7)]
    if len(observed):
        drawn.append(Item('observed', 0, 'points', VERMILION, points=observed, size=(0.005,) * 3))
    return drawn


def axes_items(group: str, pose: Pose, length: float = _AXIS) -> list[Item]:
    """Return the axes of a frame: x red, y green, z blue."""
    instance('pose', pose, Pose)
    length = number('length', length, above=0)
    return [_arrow(group, axis, pose.position, pose.position + length * pose.rotation[:, axis],
                   color) for axis, color in enumerate(_AXIS_COLORS)]


def _tube(group: str, index: int, shape: Shape, radius: float | None,
          color: tuple[float, float, float], alpha: float = 1.0) -> Item:
    instance('shape', shape, Shape)
    radius = None if radius is None else number('radius', radius, minimum=0)
    return Item(group, index, 'line', color, alpha, shape.positions,
                size=(2 * (radius or _THIN), 0.0, 0.0))


def _arrow(group: str, index: int, start: Floats, end: Floats,
           color: tuple[float, float, float]) -> Item:
    return Item(group, index, 'arrow', color, points=(start, end), size=_ARROW)


def _text(group: str, index: int, position: Floats, text: str, shape: Shape) -> Item:
    return Item(group, index, 'text', (1.0, 1.0, 1.0), text=text,
                pose=Pose(position, (0.0, 0.0, 0.0, 1.0)), size=(0.0, 0.0, _LETTER * shape.s[-1]))
