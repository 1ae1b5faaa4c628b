# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The demands on a plan as named margins: at a waypoint, between two, and of a motion.

Whoever judges takes them from here: the builder of a plan, the sweep between its waypoints, a
correction, the search for a settled motion, and the replay.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.grasp import Simulator
from dlo_planner.direct.shape import Shape, in_itself, largest_in_elements
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle, called
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import Bodies
from dlo_planner.plan.margin import GripErrors, least_margin
from dlo_planner.plan.plug_room import PlugRoom
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import Progress
from dlo_planner.uncertainty.parameters import Uncertainty

_LIGHTER = 1e-3  # of a least force: what a mesh makes of it
_TOUCHES = 1e-9  # of the length: rounding errors of a distance
ROOM = 0.25      # part of the room in a hole that a motion may lose, whatever its tolerance
_EXCEEDED = 2.0  # what breaks a demand that has no limit counts as so many limits


def nearer(apart: float) -> str:
    """Return how a DLO is to what it touches, or comes nearer to than `apart`, m: in words."""
    return f'nearer than clearance = {apart:g} m to ' if apart else 'in '


def verbatim(text: str) -> str:
    """Return a text for `Margin.words` that stays as it is: somebody chose it."""
    return text.replace('{', '{{').replace('}', '}}')


class Margin(NamedTuple):
    """How much of a demand is left; below 0 it is broken."""

    name: str  # of the demand: the constraint of `Infeasible`
    room: float
    words: str  # of a broken one, with {over}, {found} and {limit}
    found: float = np.nan
    limit: float = np.nan
    unit: str = 'm'
    place: int | None = None  # waypoint to which the gripper is going, between two of them

    @property
    def message(self) -> str:
        """The words of a broken one."""
        return self.words.format(over=-self.room, found=self.found, limit=self.limit)

    @property
    def used(self) -> float:
        """What is used of the limit, as a part of it: above 1 it is broken."""
        if self.limit > 0:
            return 1 - self.room / self.limit
        return 0.0 if self.room >= 0 else _EXCEEDED


def violated(margins: Iterable[Margin]) -> Margin | None:
    """Return the first Margin that is broken, or not known; None if none is."""
    return next((one for one in margins if not one.room >= 0), None)


@dataclass(frozen=True)
class PlanChecker:
    """The demands on a plan, for every task, and what a waypoint leaves of them."""

    speeds: tuple[float, float]  # m/s and rad/s, for the plan's times
    progress: Progress = field(default_factory=Progress)  # reports each waypoint
    workspace: Workspace | None = None
    obstacles: tuple[Obstacle, ...] = ()  # obstacles that the DLO must not touch
    touched: tuple[Obstacle, ...] = ()  # those that it may touch: its distance from them is said
    surface: Surface = Surface()  # of the DLO
    # (3,) strains since the stress-free shape, torsion and both curvatures, at which the DLO would
    # yield, 1/m. If None, it never does
    yield_limits: Floats | None = None
    allow_plastic: bool = True  # whether it may
    # DirectSimulator without obstacles that finds the DLO's shapes between the waypoints. If None,
    # the DLO is checked at the waypoints only
    simulator: Simulator | None = None
    tolerance: float | None = None  # largest position error of a waypoint, m. If None, any
    stability: float = -np.inf  # least stability of a waypoint
    # least force with which the DLO presses on the obstacle `pressed` at a waypoint, N
    min_force: float = 0.0
    # index of the obstacle that has to be pressed, in the simulator of the shapes. If None, none
    # has to be
    pressed: int | None = None
    # largest force (N) and moment (N m) of the gripper and of what else holds it; None: any
    wrench_limits: tuple[float | None, float | None] = (None, None)
    # largest angle of the DLO against its direction at a waypoint, rad. If None, any
    angle_tolerance: float | None = None
    uncertainty: Uncertainty | None = None  # of the DLO and its gripper; None: the usual one
    margin: float | None = None  # least margin in a cut-out, m. If None, any
    clearance: float = 0.0  # least distance from the obstacles and sheets, m
    # of a plan in which hands close, on its way. If None, each grip is off by an error of its own
    errors: GripErrors | None = None
    plug: Plug | None = None  # in the hand
    # whether a refusal between two waypoints says how deep the DLO would be in something: to find
    # that takes several times as long as to find that it is
    says_how_deep: bool = True

    def silent(self) -> PlanChecker:
        """Return the same demands for a search, whose steps are not reported."""
        return replace(self, progress=self.progress.silent())

    def made_with(self, simulator: Simulator) -> PlanChecker:
        """Return the same demands, the shapes between waypoints from another simulator."""
        return self if self.simulator is None else replace(self, simulator=simulator)

    @cached_property
    def _bodies(self) -> tuple[Bodies, ...]:
        return tuple(Bodies((), (obstacle,), self.surface, apart=self.clearance)
                     for obstacle in self.obstacles)

    @cached_property
    def plug_room(self) -> PlugRoom | None:
        """What tells how far the plug in the hand is from all around; None without a plug."""
        if self.plug is None:
            return None
        kept_out = () if self.workspace is None else self.workspace.keep_out
        return PlugRoom(self.plug, (*self.obstacles, *self.touched, *kept_out))

    @cached_property
    def _touched_bodies(self) -> Bodies:
        return Bodies((), self.touched, self.surface)

    def room_beside_touched(self, shape: Shape) -> float:
        """Return the smallest distance (m) of a Shape from what it may touch; inf: nothing."""
        if not self.touched:
            return np.inf
        room = self._touched_bodies.exact(shape)
        return room if abs(room) > _TOUCHES * shape.s[-1] else 0.0

    def margins(self, waypoint: Waypoint, commanded: Pose | None = None) -> Iterator[Margin]:
        """Yield how much of each demand a Waypoint leaves, in the order in which they refuse.

        `commanded`: where the robot is commanded to be, if that is not where the gripper is.
        """
        shape = waypoint.shape
        if self.workspace is not None:
            name, room = self.workspace.min_margin(commanded or shape.gripper)
            yield Margin(name, room, f'the gripper is {{over:.3g}} m beyond {name}')
        if self.plug_room is not None:
            apart, touched = self.plug_room.at(commanded or shape.gripper)
            yield Margin('plug', apart, f'the plug is {{over:.3g}} m in {verbatim(touched)}')
        if self.tolerance is not None:
            yield Margin('tolerance', self.tolerance - waypoint.position_error, 'the DLO is '
                         '{found:.3g} m off, tolerance = {limit:g} m', waypoint.position_error,
                         self.tolerance)
        if self.angle_tolerance is not None:
            yield Margin('angle_tolerance', self.angle_tolerance - waypoint.misalignment, 'the DLO '
                         'is {found:.3g} rad off its direction, angle_tolerance = {limit:g} rad',
                         waypoint.misalignment, self.angle_tolerance, 'rad')
        yield Margin('clearance', waypoint.clearance - self.clearance, 'the DLO is {over:.3g} m in '
                     'the sheet around a cut-out (infinite, if no Sheet among the obstacles has '
                     'this hole): it would need as much more room')
        around = [sheet for sheet, _ in waypoint.sheets]
        for index, (obstacle, body) in enumerate(zip(self.obstacles, self._bodies, strict=True)):
            if any(obstacle is sheet for sheet in around):
                continue  # that is its clearance
            yield Margin('clearance', body.exact(shape),
                         'the DLO is {over:.3g} m ' + nearer(self.clearance)
                         + verbatim(called(obstacle, index)))
        if self.margin is not None:
            found = least_margin(self.uncertainty, shape, [s for _, s, _ in waypoint.via_points],
                                 waypoint.clearances, self.errors)
            if not np.isnan(found):
                yield Margin('margin', found - self.margin, 'the clearance less two standard '
                             'deviations of the expected miss would be {found:.3g} m, margin = '
                             '{limit:g} m is required', found, self.margin)
        yield Margin('stability', shape.stability - self.stability, 'the DLO would hardly stay in '
                     'this shape: stability {found:.3g}, at least {limit:g} is required',
                     shape.stability, self.stability, '')
        if self.min_force:
            force = sum(one.force for one in shape.contacts if one.obstacle == self.pressed)
            room = force - self.min_force
            yield Margin('contact_force', room if room < -_LIGHTER * self.min_force else 0.0,
                         'the DLO would press with {found:.3g} N, at least {limit:.3g} N are '
                         'required (min_force)', force, self.min_force, 'N')
        if self.wrench_limits != (None, None):
            yield from wrench_margins(self.wrench_limits, largest_wrench(shape))
        yield Margin('self_distance', -in_itself(shape, self.surface), 'the DLO would lie '
                     '{over:.3g} m in itself: nothing holds its pieces off each other')
        yield from self.bend_margins(shape)

    def bend_margins(self, shape: Shape) -> Iterator[Margin]:
        """Yield how much of the demands on bends and twists a Shape leaves, wherever it is."""
        rod = shape.rod
        if rod is not None and rod.max_bend_curvature is not None:
            yield Margin('max_bend_curvature', shape.bend_margin, 'the DLO is bent by {over:.3g} '
                         '1/m more than max_bend_curvature = {limit:g} 1/m',
                         limit=rod.max_bend_curvature, unit='1/m')
        if not self.allow_plastic and self.yield_limits is not None:
            load = utilization(shape, self.yield_limits)
            yield Margin('yield', 1 - load, 'the DLO would yield: bent or twisted to {found:.3g} '
                         'times its limits', load, unit='')

    def violation(self, waypoint: Waypoint, commanded: Pose | None = None) -> Margin | None:
        """Return the Margin of the first demand that a Waypoint breaks, or None."""
        return violated(self.margins(waypoint, commanded))


def wrench_margins(limits: Sequence[float | None], largest: Floats) -> Iterator[Margin]:
    """Yield how much of the limits of grips, of force and moment, the `largest_wrench` leaves."""
    for name, unit, limit, most in zip(('max_force', 'max_moment'), ('N', 'N m'), limits,
                                       largest.tolist(), strict=True):
        if limit is not None:
            yield Margin(name, limit - most, f'a grip would exert {{found:.3g}} {unit}, at most '
                         f'{name} = {{limit:g}} {unit} is allowed', most, limit, unit)


def largest_wrench(shape: Shape) -> Floats:
    """Return (2,) the largest force (N) and moment (N m) that a grip exerts on a Shape."""
    wrenches = np.vstack([shape.gripper_wrench, shape.wrenches]).reshape(-1, 2, 3)
    result: Floats = np.linalg.norm(wrenches, axis=2).max(axis=0)
    return result


def motion_margins(motion: Mapping[str, float], planned_miss: float, tolerance: float,
                   touches: bool, room: float | None = None,
                   limits: Sequence[float | None] = (None, None)) -> list[Margin]:
    """Return how much of each demand a motion leaves, by its figures as `InMotion` names them.

    Those that are nan were not looked at. planned_miss: position error of the plan, m; touches:
    whether the DLO means to touch something; room: clearance of the DLO that follows slowly, m,
    where the motion has to be calm. If None, it has not; limits: of force (N) and moment (N m) at
    every grip, None: any.
    """
    if not motion['converged']:
        return [Margin('motion', -np.inf, 'the motion could not be simulated to its end', limit=1,
                       unit='')]
    missed = motion['position_error'] - planned_miss
    margins = [
        Margin('clearance', motion['clearance'],
               'in motion the DLO is {over:.3g} m in the sheet or an obstacle', limit=tolerance),
        Margin('contact', 0.0 if touches else -motion['contact_force'],
               'in motion the DLO touches something, with {over:.3g} N', unit='N'),
        Margin('contact', -motion['contact_lost'],
               'the DLO loses a contact that the plan keeps, {over:.2%} of the time', unit=''),
        Margin('max_bend_curvature', motion['bend_margin'],
               'in motion the DLO is bent by {over:.3g} 1/m more than max_bend_curvature',
               unit='1/m'),
        Margin('miss', tolerance - missed, f'in motion the DLO misses by '
               f'{motion["position_error"]:.3g} m: expected at most {planned_miss + tolerance:.3g} '
               'm', missed, tolerance)]
    if room is not None:
        # far from everything more may be lost than where it is narrow; between two waypoints the
        # plan may come nearer than at both
        room = min(room, motion['calm_clearance'])
        most, lost = max(tolerance, ROOM * room), room - motion['clearance']
        margins += [
            Margin('clearance', most - lost, 'in motion the DLO loses {found:.3g} m of its room: '
                   'expected at most {limit:.3g} m', lost, most),
            Margin('departure', tolerance - motion['departure'], 'at the end the DLO vibrates by '
                   '{found:.3g} m: expected at most {limit:.3g} m', motion['departure'],
                   tolerance)]
    margins += [one._replace(words='in motion ' + one.words) for one in wrench_margins(
        limits, np.array([motion.get('grip_force', np.nan), motion.get('grip_moment', np.nan)]))]
    return [one for one in margins if not np.isnan(one.room)]


def utilization(shape: Shape, yield_limits: Floats) -> float:
    """Return the largest of `yield_shares`."""
    return float(yield_shares(shape, yield_limits).max())


def yield_shares(shape: Shape, yield_limits: Floats) -> Floats:
    """Return (N_L,) the largest strains of elements as a part of the yield limits.

    Curvature counts by the ellipse of its two limits, of a rectangle by the strain of its corners;
    torsion counts separately.

    Shapes: yield_limits (3,).
    """
    assert shape.rod is not None  # `bent` needs it too
    cornered = shape.rod.section_outline[0] == 'rectangular'

    def share(bent: Floats) -> Floats:
        part: Floats = np.abs(bent) / yield_limits
        bend = part[:, 1] + part[:, 2] if cornered else np.hypot(part[:, 1], part[:, 2])
        return np.maximum(part[:, 0], bend)

    return largest_in_elements(shape, share)
