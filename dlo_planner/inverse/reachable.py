# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shapes that a DLO takes as its gripper turns, from the one that hangs straight down.

Where the gripper is, and its heading about the vertical, do not change a shape: the directions of
the vertical in the gripper's frame are a sphere, and of a round straight DLO, whose roll changes
nothing either, a half circle. A flood over its points, each shape followed from a neighbor, finds
what a robot can come to without a fall. The sphere of free ends (`inverse.equilibria`) has all
equilibria, but hardly any of its points is a stable one of a DLO that is soft for its weight.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.continuation import follow
from dlo_planner.direct.sensitivity import HangingSensitivities
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import StepInputs, step
from dlo_planner.geometry.so3 import matrix, rotation_vector, times_transposed
from dlo_planner.inverse.equilibria import (
    HangingShapes,
    common_axis,
    frames_with,
    is_axisymmetric,
    sphere,
)
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose, turned_by

_ELEMENTS = 64           # of each shape: a search is as exact as its grid
_ARC = np.deg2rad(1.5)   # between two grippers of a round straight DLO
_POINTS = 600            # of the sphere of any other: 0.15 rad apart
_HALVINGS = 4            # of a step on the arc, where the DLO falls


class Reachable(NamedTuple):
    """The n shapes that a flood came to, on one mesh, the gripper in the origin."""

    up: Floats  # (3,) unit vector against the loads
    s: Floats  # (N + 1,) arc lengths of the nodes, m
    shapes: list[Shape]  # (n,)
    strains: Floats  # (n, N, 3) 1/m
    frames: Floats  # (n, N + 1, 3, 3)
    positions: Floats  # (n, N + 1, 3) m
    stability: Floats  # (n,)
    edges: Ints  # (m, 2) indices of neighbors
    spacing: float  # how far apart they are, rad; 0: in a row

    @property
    def hanging(self) -> HangingShapes:
        """The same as HangingShapes."""
        return HangingShapes(self.up, self.s, self.frames, self.positions, self.stability,
                             self.edges, self.spacing)

    def chosen(self, some: Bools) -> Reachable:
        """Return some of the shapes (a mask)."""
        if some.all():
            return self
        return self._replace(shapes=[self.shapes[k] for k in np.flatnonzero(some)], **{
            name: getattr(self, name)[some]
            for name in ('strains', 'frames', 'positions', 'stability')})


def reachable_shapes(simulator: DirectSimulator, stability: float,
                     check: Callable[[], None]) -> Reachable | None:
    """Return the Reachable shapes that are more than so stable, or None.

    None: the loads are not along one axis, or the DLO that hangs straight down is not that stable.
    `check` is called between the steps; it may raise.
    """
    around = simulator.surroundings
    coarse = DirectSimulator(around.rod, n_elements=_ELEMENTS, basis='local',
                             gravity=around.gravity, load=around.load,
                             point_loads=around.point_loads)
    up = common_axis(coarse.mesh.static.pull)  # the potential's slopes: against the loads
    if up is None:
        return None
    shapes, edges = (_arc if is_axisymmetric(around.rod) else _flood)(coarse, up, stability, check)
    if not shapes:
        return None
    strains, frames, positions, stabilities = (
        np.array([getattr(shape, name) for shape in shapes])
        for name in ('element_strains', 'frames', 'positions', 'stability'))
    return Reachable(up, np.array(shapes[0].s), shapes, strains, frames, positions, stabilities,
                     edges, 0.0 if is_axisymmetric(around.rod) else 2 / np.sqrt(_POINTS))


def hanging_straight(simulator: DirectSimulator) -> Shape | None:
    """Return the Shape of a DLO whose gripper points straight down; None: there is none."""
    up = common_axis(simulator.mesh.static.pull)
    if up is None:
        return None
    shape = simulator.solve(_held(_downwards(up)))
    return shape if shape.converged else None


def _downwards(up: Floats) -> Floats:
    """Return a rotation (3, 3) whose x axis is against `up`."""
    rotation: Floats = frames_with(np.array([[-1.0, 0.0, 0.0]]), up)[0]
    return rotation


def _is_good(shape: Shape, stability: float) -> bool:
    return shape.converged and not shape.jumped and shape.stability > stability


class _Steps:
    """Steps of a DLO that hangs freely, each begun where it comes to by its sensitivity.

    From where it hung before, turned along, the first step of Newton's method on a soft DLO goes so
    far that following it would halve the step.
    """

    def __init__(self, simulator: DirectSimulator) -> None:
        self._mesh = simulator.mesh
        self._before: Shape | None = None
        self._turned: Floats | None = None  # (3, N, 3) change of its strains by its gripper's turns

    def __call__(self, gripper: Pose, before: Shape, holds: Holds = (),
                 most: float = np.inf) -> Shape:
        """Return the Shape of a step; for `follow`."""
        if before is not self._before:
            self._before, mesh = before, HangingSensitivities.mesh_of([before])
            self._turned = None if mesh is None else HangingSensitivities(mesh, [before]).answers(
                np.zeros((1, 0, *before.element_strains.shape)))[0][0]
        start = None if self._turned is None else _predicted(
            self._turned, before.element_strains, before.gripper.rotation, gripper.rotation)
        return step(self._mesh, gripper, before, StepInputs(holds=holds, most=most), start)

    def followed(self, before: Shape, gripper: Pose) -> Shape:
        """Return the Shape in another gripper; it has `jumped` where the DLO falls on the way."""
        return follow(self, before, gripper)


@kernel
def _predicted(turned: Floats, strains: Floats, before: Floats, after: Floats) -> Floats:
    """Return strains (N, 3) in a gripper that turns from `before` to `after`, (3, 3), in the world.

    Args:
        turned: (3, N, 3) changes by that turn
        strains: (N, 3), before, after: read-only
    """
    x, y, z = rotation_vector(times_transposed(matrix(after), matrix(before)))
    out = np.empty(strains.shape)
    for e in range(strains.shape[0]):
        for i in range(3):
            out[e, i] = (strains[e, i] + x * turned[0, e, i] + y * turned[1, e, i]
                         + z * turned[2, e, i])
    return out


def _arc(simulator: DirectSimulator, up: Floats, stability: float,
         check: Callable[[], None]) -> tuple[list[Shape], Ints]:
    """Return the shapes of a round straight DLO as its gripper rises from straight down."""
    hanging = _downwards(up)
    axis, angle, shape = hanging[:, 1], 0.0, simulator.solve(_held(hanging))
    steps = _Steps(simulator)
    shapes: list[Shape] = []
    while _is_good(shape, stability):
        shapes.append(shape)
        for halving in range(_HALVINGS):
            check()
            further = angle + _ARC / 2**halving
            if further > 2 * np.pi:
                return shapes, _chain(len(shapes))
            shape = steps.followed(shapes[-1], _held(turned_by(-further * axis) @ hanging))
            if _is_good(shape, stability):
                angle = further
                break
    return shapes, _chain(len(shapes))


def _chain(n: int) -> Ints:
    """Return the neighbors (n - 1, 2) in a row of n."""
    return np.column_stack([np.arange(n - 1), np.arange(1, n)])


def _flood(simulator: DirectSimulator, up: Floats, stability: float,
           check: Callable[[], None]) -> tuple[list[Shape], Ints]:
    """Return the shapes on a grid of the sphere that are followed from neighbors without a fall."""
    directions, edges = sphere(_POINTS)
    grippers = frames_with(directions, up)
    neighbors: list[list[int]] = [[] for _ in directions]
    for a, b in edges.tolist():
        neighbors[a].append(b)
        neighbors[b].append(a)
    first = int(np.argmin(directions[:, 0]))
    found = {first: simulator.solve(_held(grippers[first]))}
    if not _is_good(found[first], stability):
        return [], edges[:0]
    waiting, steps = deque([first]), _Steps(simulator)
    while waiting:
        one = waiting.popleft()
        check()
        for other in neighbors[one]:
            if other in found:
                continue
            # of all headings the one that turns the gripper least
            turn = grippers[other] @ found[one].gripper.rotation.T
            heading = np.arctan2(up @ _twist(turn), np.trace(turn) - up @ turn @ up)
            shape = steps.followed(found[one], _held(turned_by(-heading * up) @ grippers[other]))
            if _is_good(shape, stability):
                found[other] = shape
                waiting.append(other)
    order = sorted(found)
    there = np.isin(edges, order).all(axis=1)
    return [found[k] for k in order], np.searchsorted(order, edges[there])


def _twist(turn: Floats) -> Floats:
    """Return (3,) twice the axial vector of a matrix (3, 3)."""
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def _held(rotation: Floats) -> Pose:
    return Pose.from_rotation((0.0, 0.0, 0.0), rotation)
