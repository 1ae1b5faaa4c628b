# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The demands on a plan, and what breaks them at a waypoint."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from dlo_planner.direct.shape import Shape, in_itself
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import clearance
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import Progress

_LIGHTER = 1e-3  # of a least force: what a mesh makes of it


@dataclass(frozen=True)
class PlanRequirements:
    """The demands on a plan, for every task."""

    speeds: tuple[float, float]  # m/s and rad/s, for the plan's times
    progress: Progress = field(default_factory=Progress)  # Progress, which reports each waypoint
    workspace: Workspace | None = None  # Workspace or None
    obstacles: tuple[Obstacle, ...] = ()  # obstacles that the DLO must not touch
    surface: Surface = Surface()  # Surface of the DLO
    # (3,) or None strains since the stress-free shape, torsion and both curvatures, at which the
    # DLO would yield, 1/m, or None where it may
    yield_limits: Floats | None = None
    # DirectSimulator without obstacles that finds the DLO's shapes between the waypoints. If None,
    # the DLO is checked at the waypoints only
    simulator: DirectSimulator | None = None
    tolerance: float | None = None  # largest position error of a waypoint, m. If None, any
    stability: float = -np.inf  # least stability of a waypoint
    # least force with which the DLO presses on the obstacle `pressed` at a waypoint, N
    min_force: float = 0.0
    # index of the obstacle that has to be pressed, in the simulator of the shapes. If None, none
    # has to be
    pressed: int | None = None

    def silent(self, simulator: DirectSimulator | None = None) -> PlanRequirements:
        """Return the same demands for a search, whose steps are not reported."""
        return replace(self, progress=self.progress.silent(), simulator=self._between(simulator))

    def made_with(self, simulator: DirectSimulator | None) -> PlanRequirements:
        """Return the same demands, the shapes between waypoints from another simulator."""
        return replace(self, simulator=self._between(simulator))

    def _between(self, simulator: DirectSimulator | None) -> DirectSimulator | None:
        return self.simulator if self.simulator is None or simulator is None else simulator

    def violation(self, waypoint: Waypoint) -> tuple[str, float, str] | None:
        """Return constraint, amount and words of the demand that a Waypoint breaks, or None."""
        shape = waypoint.shape
        if self.workspace is not None:
            name, room = self.workspace.min_margin(shape.gripper)
            if room < 0:
                return name, -room, f'the gripper is {-room:.3g} m beyond {name}'
        if self.tolerance is not None and waypoint.position_error > self.tolerance:
            return ('tolerance', waypoint.position_error - self.tolerance,
                    f'the DLO is {waypoint.position_error:.3g} m off, tolerance = '
                    f'{self.tolerance:g} m')
        if waypoint.clearance < 0:
            return ('clearance', -waypoint.clearance,
                    f'the DLO is {-waypoint.clearance:.3g} m in the sheet around a cut-out '
                    '(infinite, if no Sheet among the obstacles has this hole): it would need as '
                    'much more room')
        for index, obstacle in enumerate(self.obstacles):
            room = clearance([obstacle], self.surface, shape)
            if room < 0:
                return ('clearance', -room,
                        f'the DLO is {-room:.3g} m in {type(obstacle).__name__} {index}')
        if not shape.stability >= self.stability:  # nan: it was not looked at
            return ('stability', self.stability - shape.stability, 'the DLO would hardly stay in '
                    f'this shape: stability {shape.stability:.3g}, at least {self.stability:g} is '
                    'required')
        force = sum(one.force for one in shape.contacts if one.obstacle == self.pressed)
        if force < (1 - _LIGHTER) * self.min_force:
            return ('contact_force', self.min_force - force, f'the DLO would press with {force:.3g}'
                    f' N, at least {self.min_force:.3g} N are required (min_force)')
        overlap = in_itself(shape, self.surface)
        if overlap > 0:
            return ('self_distance', overlap, f'the DLO would lie {overlap:.3g} m in itself: '
                    'nothing holds its pieces off each other')
        if shape.rod is not None and shape.bend_margin < 0:
            return ('max_bend_curvature', -shape.bend_margin,
                    f'the DLO is bent by {-shape.bend_margin:.3g} 1/m more than '
                    f'max_bend_curvature = {shape.rod.max_bend_curvature:g} 1/m')
        if self.yield_limits is not None:
            load = utilization(shape, self.yield_limits)
            if load > 1:
                return ('yield', load - 1, f'the DLO would yield: bent or twisted to {load:.3g} '
                        'times its limits')
        return None


def utilization(shape: Shape, yield_limits: Floats) -> float:
    """Return the largest of `yield_shares`."""
    return float(yield_shares(shape, yield_limits).max())


def yield_shares(shape: Shape, yield_limits: Floats) -> Floats:
    """Return (N_L,) the strains since the stress-free shape as a part of the yield limits.

    Curvature counts by the ellipse of its two limits, of a rectangle by the strain of its corners;
    torsion counts separately.

    Shapes: yield_limits (3,).
    """
    assert shape.rod is not None  # `bent` needs it too
    part: Floats = np.abs(shape.bent) / yield_limits
    cornered = shape.rod.section_outline[0] == 'rectangular'
    bend = part[:, 1] + part[:, 2] if cornered else np.hypot(part[:, 1], part[:, 2])
    return np.maximum(part[:, 0], bend)
