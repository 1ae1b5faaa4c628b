# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Aiming a DLO at a place that it has to pass: where it is level with it, and what is to be done.

The gripper goes anywhere, and its axis turns as the DLO does about what holds next to it. The least
of such motions by which the DLO would be where it should is found from its sensitivities.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.sliding import answers_at
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

_ROUNDS = 20     # of finding the level place
_EXACT = 1e-12   # of the length: it is found
_STEEP = 0.2     # cosine: what is steeper is taken to be as steep as that


class Aim(NamedTuple):
    """What the DLO is to be like at a place."""

    pose: Pose       # x axis: its tangent
    aside: Floats    # (3,) unit vector across the DLO and the mouth
    s: float | None  # the place of the DLO that is to be there, m; None: whichever is nearest

    @property
    def places(self) -> Floats:
        """(k, 3) directions in which its place counts: aside, out of the mouth, along."""
        along = self.pose.rotation[:, 0]
        out = np.cross(along, self.aside)
        return np.array([self.aside, out] if self.s is None else [self.aside, out, along])

    def level(self, shape: Shape) -> float:
        """Return the place of a Shape that is level with it along its tangent, m."""
        if self.s is not None:
            return self.s
        most = part_led(shape)
        inside = shape.s <= most
        away = np.linalg.norm(shape.positions[inside] - self.pose.position, axis=1)
        s, along = float(shape.s[inside][away.argmin()]), self.pose.rotation[:, 0]
        for _ in range(_ROUNDS):
            axes, place = shape.frame_at(s)
            by = float((self.pose.position - place) @ along) / max(
                float(axes[:, 0] @ along), _STEEP)
            s = min(max(s + by, 0.0), most)
            if abs(by) < _EXACT * shape.s[-1]:
                break
        return s

    def rows(self, shape: Shape) -> tuple[Floats, float]:
        """Return (k,) what a Shape misses, of its length, and the largest; infinite: it returns."""
        axes, place = shape.frame_at(self.level(shape))
        rows = self.places @ (place - self.pose.position) / shape.s[-1]
        ahead = axes[:, 0] @ self.pose.rotation[:, 0] > 0
        return rows, float(np.abs(rows).max()) if ahead else np.inf

    def miss(self, shape: Shape) -> float:
        """Return how far a Shape is off, m."""
        place = shape.frame_at(self.level(shape))[1]
        return float(np.linalg.norm(place - self.pose.position))

    def step(self, shape: Shape, rows: Floats, straight: float) -> Floats:
        """Return the least twist (6,) of the gripper by which what it misses, `rows` (k,), is 0.

        `straight`: how far the gripper is to be from what holds next to it, of the DLO between.
        """
        s, length = self.level(shape), float(shape.s[-1])
        answer, (axes, _) = answers_at(shape, [s])[0, :, :6], shape.frame_at(s)
        tangent, moved = axes[:, 0], answer[3:]
        if self.s is None:  # another place is level then
            along = self.pose.rotation[:, 0]
            moved = moved - np.outer(tangent, along @ moved) / float(along @ tangent)
        slopes, swings = self.places @ moved / length, np.zeros((6, 3))
        swings[3:] = length * np.eye(3)
        if shape.holds:
            way = shape.gripper.position - shape.holds[0].pose.position
            size = float(np.linalg.norm(way))
            # as slack as it is to be, whatever slides: else it would draw, or sag
            slopes = np.vstack([slopes, np.append(np.zeros(3), way / size) / length])
            rows = np.append(rows, size / length - straight * part_led(shape) / length)
            swings[:3] = length * np.cross(way, np.eye(3)).T / (way @ way)
        step: Floats = -swings @ (np.linalg.pinv(slopes @ swings, rcond=1e-6) @ rows)
        return step


def part_led(shape: Shape) -> float:
    """Return how much of the DLO is between the gripper and what holds next to it, m."""
    last = shape.holds[0].s if shape.holds else None
    return float(shape.s[-1]) if last is None else last


def straightness(shape: Shape) -> float:
    """Return how far the gripper is from what holds next to it, of the DLO between; 1: free."""
    if not shape.holds:
        return 1.0
    way = shape.gripper.position - shape.holds[0].pose.position
    return float(np.linalg.norm(way)) / part_led(shape)
