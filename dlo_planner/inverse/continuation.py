# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Families of shapes that do a task at each depth, followed without a discontinuity.

The goals leave the gripper one free rotation, a roll. At each depth the shapes that keep them are a
curve on the sphere of all hanging shapes (`inverse.equilibria`); a step goes to the next curve, by
Newton's method, with no roll or with a given one (`inverse.waypoint_newton` says about which axis).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from itertools import pairwise, takewhile
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from dlo_planner.direct.continuation import fell
from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.extras import studied
from dlo_planner.inverse.equilibria import Crossings, HangingShapes, crossings
from dlo_planner.inverse.waypoint_newton import ORIGIN, Found, follow, free_axis, goal_shape
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose, turned_by
from dlo_planner.model.value import freeze
from dlo_planner.plan.builder import PlanBuilder, refusal_for_accuracy, refusal_for_leap
from dlo_planner.plan.continuity import apart, excess, largest_turn, without_doubt
from dlo_planner.plan.goal_rows import DIRECTION, POSITION, ROLL, THROUGH, GoalTable
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

LONGEST_STEP = 1 / 16   # of the length
_AHEAD = 4.0             # steps ahead that a trend is believed for
_SHARES = 1.0, 0.5, 0.0  # of a roll
_ROLLS = (0.2, -0.2, 0.5, -0.5, 1.0, -1.0)  # of the largest turn, tried between two waypoints
DOUBTFUL = 0.05    # stability below which another roll is looked for
_AT_ONCE = 32      # waypoints that are found in one call
_LATER = 8         # waypoints until that is tried again, where one was in doubt
_ALIGNED = 1e-8    # rad: of what another solver finds
_AROUND = 0.25     # of the length: how far before a guess a place is sought


class BranchPoint(NamedTuple):
    """A Shape that satisfies a condition at some depth."""

    shape: Shape
    further: tuple[float, ...] = ()  # arc lengths at the further centers that it passes, m
    depth: float = float('nan')  # its depth, m; nan: not known
    # the one that it was followed from, without its own. None: not known
    since: BranchPoint | None = None
    # (3, 3) or None axes of the DLO at the first center. None: not known
    axes: Floats | None = None

    @property
    def gripper(self) -> tuple[Floats, Floats]:
        """The gripper's rotation (3, 3) and its position (3,), m."""
        return self.shape.gripper.rotation, self.shape.gripper.position

    def waypoint(self, center: Floats, s: float, normal: Floats | None) -> Waypoint:
        """Return the Waypoint that passes the first center (3,) at `s`, m."""
        return waypoint_at(self.shape, center, s, normal,
                           None if self.axes is None else (self.axes, center))

    def after(self, before: BranchPoint) -> BranchPoint:
        """Return the same, followed from another one."""
        since = before._replace(since=None, axes=None)
        return self._replace(since=since)

    def trend(self, depth: float) -> tuple[Shape, float] | None:
        """Return the Shape before on the same mesh, and how many such steps to `depth`, or None."""
        if self.since is None or self.since.shape.s is not self.shape.s:
            return None
        ahead = steps_ahead(self.depth - self.since.depth, depth - self.depth)
        return (self.since.shape, ahead) if ahead else None


def steps_ahead(last: float, step: float) -> float:
    """Return how many times the last step (m) a step is; 0 if it is not a few times as long."""
    ahead = step / last if last else 0.0
    return ahead if 0.0 < ahead <= _AHEAD else 0.0


class RollSchedule(Protocol):
    """How the gripper rolls from one depth to another."""

    def roll(self, branch: SolutionBranch, point: BranchPoint, depth: float,
             target: float) -> float:
        """Return the roll (rad) from `depth` to `target`, m."""


class Step(NamedTuple):
    """How far a BranchPoint could be followed."""

    point: BranchPoint | None  # at the depth that was wanted. If None, it was not reached
    depth: float  # that was reached, m
    jump: float = 0.0  # how far the gripper would have to jump there, m; 0: there is no shape
    sure: bool = False  # neither gripper nor DLO can jump to it: nobody need look closer


class SolutionBranch(ABC):
    """The shapes that do a task at each depth: a curve of them on the sphere of all equilibria."""

    what: ClassVar[str]             # the shapes, in words
    longest: ClassVar[float] = LONGEST_STEP  # steps of the depth, parts of the length
    shortest: ClassVar[float] = 1 / 1024
    soft: ClassVar[bool] = False     # goals are missed least, in steps that cannot jump

    simulator: DirectSimulator
    normals: Sequence[Floats] = ()   # (3,) of the cut-outs whose direction counts

    @abstractmethod
    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at `depth` (m) near `before`, rolled by `roll` (rad), or None.

        `final`: it is a waypoint, not a step on the way to one.
        """

    def axis(self, shape: Shape) -> Floats:
        """Return the axis (3,) of the roll that the goals leave free."""
        return np.array(shape.gripper.rotation[:, 0])

    def batch_ahead(self, before: BranchPoint, depths: Floats) -> list[BranchPoint]:
        """Return the BranchPoints at the first of some depths (k,), without roll, as far as sure.

        As `at` finds them, in less time. There may be none: where the gripper or the DLO might
        jump, where the DLO is hardly stable, and where another mesh is needed.
        """
        del before, depths
        return []

    def against(self, point: BranchPoint) -> tuple[str, float] | None:
        """Return the name of a cut-out that is passed against its direction, and the cosine."""
        shape = point.shape
        for k, (normal, s) in enumerate(zip(
                self.normals, (shape.s[-1] - point.depth, *point.further), strict=False)):
            axes = point.axes if k == 0 and point.axes is not None else shape.frame_at(s)[0]
            along = float(axes[:, 0] @ normal)
            if along <= 0:
                return f'cut-out {k}', along
        return None

    def too_far(self, before: BranchPoint, after: BranchPoint, step: float) -> float:
        """Return by how much (m) the gripper moves too far in a step of the depth, m; or 0."""
        length = self.simulator.rod.length
        return 0.0 if self.soft else excess(before.gripper, after.gripper, step / length, length)

    def follow(self, point: BranchPoint, depth: float, goal: float,
               route: RollSchedule | None = None) -> Step:
        """Continue a BranchPoint from one depth to another, in steps that do not jump."""
        length = self.simulator.rod.length
        step = longest = self.longest * length
        while True:
            target = depth + min(max(goal - depth, -step), step)
            roll = 0.0 if route is None else route.roll(self, point, depth, target)
            for share in _SHARES if roll else (1.0,):  # what cannot be rolled at once: later
                found = self.at(point, target, share * roll, target == goal)
                too_far = 0.0 if found is None else self.too_far(point, found, target - depth)
                if found is not None and not too_far:
                    break
            if found is not None and not too_far:
                point, depth = found, target
                if depth == goal:
                    return Step(point, depth)
                step = min(2 * step, longest)
            elif step <= self.shortest * length or target == depth:
                return Step(None, depth, too_far)
            else:
                step /= 2

    def refusal(self, builder: PlanBuilder, before: BranchPoint | None,
                step: Step) -> Infeasible | None:
        """Return why a Step does not lead to the next waypoint of a PlanBuilder, or None."""
        point = step.point
        if point is None and step.jump:
            return builder.refusal('continuity', step.jump, 'the gripper would have to jump at '
                                   f'depth {step.depth:.4g} m: the shapes {self.what} turn back '
                                   'there')
        if point is None:
            return builder.refusal('equilibrium', abs(builder.depth - step.depth), 'no equilibrium '
                                   f'{self.what} was found beyond depth {step.depth:g} m')
        stability = point.shape.stability
        if stability < -NEUTRAL:
            return builder.refusal('stability', -stability, 'the DLO would not stay in the shape '
                                   f'{self.what}; stability {stability:.3g} < 0', '')
        against = self.against(point)
        if against is not None:
            return builder.refusal('direction', -against[1], f'the DLO would pass {against[0]} '
                                   'against its direction', '')
        too_far = 0.0 if before is None else self.too_far(before, point, builder.step)
        if too_far:
            return builder.refusal('continuity', too_far, 'the gripper would have to turn or move '
                                   'too far since the waypoint before; closer waypoints may help')
        return refusal_for_leap(self.simulator, builder, point.shape)

    def replayed(self, last: Shape | None, point: BranchPoint) -> BranchPoint:
        """Return a BranchPoint as a motion from the last waypoint finds it, on that motion's mesh.

        The search takes smaller steps, some backwards: its mesh would miss by the accuracy.
        """
        if self.soft or self.simulator.mesh_after(last) is point.shape.mesh:
            return point
        replayed = self.simulator.track([point.shape.gripper], initial=last)[0]
        if not replayed.converged or replayed.jumped:
            return point
        return self.at(point._replace(shape=replayed), point.depth, 0.0, True) or point


class Follower:
    """Goes through n depths: many at once as long as nothing is in doubt, else one by one."""

    def __init__(self, branch: SolutionBranch, point: BranchPoint | None, depth: float,
                 depths: Floats, route: RollSchedule | None = None) -> None:
        self.branch, self.point, self.depth = branch, point, depth  # where it is
        self._depths, self._route = depths, route
        self._ready: list[BranchPoint] = []  # the next ones, the last first
        self._doubtful = 1  # where more are looked for

    def step(self, index: int) -> Step:
        """Go on to the depth of an index, from the one before it."""
        target = float(self._depths[index])
        if self.point is None:
            return Step(None, self.depth)
        if not self._ready and index >= self._doubtful and self._route is None:
            ahead = self._depths[index:index + _AT_ONCE]
            self._ready = self.branch.batch_ahead(self.point, ahead)[::-1]
            self._doubtful = index + max(len(self._ready), _LATER)
        found = (Step(self._ready.pop(), target, sure=True) if self._ready else
                 self.branch.follow(self.point, self.depth, target, self._route))
        if found.point is not None:
            self.point, self.depth = found.point, target
        return found


def continue_branch(builder: PlanBuilder, follower: Follower,
                    waypoint: Callable[[BranchPoint], Waypoint], *,
                    may_roll: bool = False) -> tuple[list[BranchPoint], bool]:
    """Fill a PlanBuilder with the waypoints of a SolutionBranch, or raise Infeasible.

    Also returned is whether the gripper rolled, which it does only where a waypoint needs it.
    """
    branch, points, rolled = follower.branch, list[BranchPoint](), False
    for index in range(builder.wanted):
        builder.check()
        before = follower.point if points else None
        step = follower.step(index)
        refusal = None if step.sure else branch.refusal(builder, before, step)
        point = None if refusal is not None else step.point
        if before is not None and may_roll and (
                point is None or point.shape.stability < DOUBTFUL):
            rolled = True
            point = _rolled(builder, branch, before, point)
        if point is None:
            assert refusal is not None  # else there is one
            raise refusal
        point = branch.replayed(builder.last, point)
        follower.point, follower.depth = point, point.depth
        builder.add(waypoint(point))
        points.append(point)
    return points, rolled


def _rolled(builder: PlanBuilder, branch: SolutionBranch, before: BranchPoint,
            best: BranchPoint | None) -> BranchPoint | None:
    """Return a BranchPoint rolled as little as makes it stable enough, or the most stable one."""
    target = builder.depth
    most = largest_turn(builder.step / branch.simulator.rod.length)
    for part in _ROLLS:
        rolled = branch.at(before, target, part * most, True)
        if rolled is None or best is not None and rolled.shape.stability <= best.shape.stability:
            continue
        if branch.refusal(builder, before, Step(rolled, target)) is None:
            best = rolled
            if rolled.shape.stability >= DOUBTFUL:
                break  # no larger roll than needed: the gripper's path stays smooth
    return best


class Aligned(SolutionBranch):
    """The shapes whose tangent, at each depth, is along a normal (3,) in a center (3,), m.

    Method 'nested' is for waypoints; the coupled one makes all steps between.
    """

    what = 'whose tangent is along the normal'

    def __init__(self, simulator: DirectSimulator, normal: Floats, center: Floats = ORIGIN,
                 method: str = 'coupled') -> None:
        self.simulator, self.normal, self._center = simulator, np.array(normal), center
        self._nested = method == 'nested'

    def axis(self, shape: Shape) -> Floats:
        """Return the mean of the gripper's axis and the normal."""
        return free_axis(np.array(shape.gripper.rotation), self.normal)

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at `depth`, with no roll or a given one."""
        reference, trend = before.shape.gripper.rotation, before.trend(depth)
        if roll:
            trend = None
            reference = turned_by(roll * self.axis(before.shape)) @ reference
        point = self.from_guess(before.shape, depth, reference, final, trend)
        return point and point.after(before)

    def from_guess(self, guess: Shape, depth: float, reference: Floats, final: bool = True,
                   trend: tuple[Shape, float] | None = None) -> BranchPoint | None:
        """Return the BranchPoint near a Shape, not turned about the free axis since `reference`."""
        s = self.simulator.rod.length - depth
        if final and self._nested:
            aligned_by = studied('nested.nested_alignment')
            shape: Shape = aligned_by(self.simulator, guess, s, self.normal, reference)
            across = np.linalg.norm(np.cross(shape.at(s).direction, self.normal))
            aligned = across < _ALIGNED and shape.at(s).direction @ self.normal > 0
            if not (shape.converged and aligned):
                return None
            axes, place = shape.frame_at(s)
            return BranchPoint(carried(shape, self._center - place), depth=depth, axes=axes)
        found = goal_shape(self.simulator, guess, _along(self.normal, reference), s, self.normal,
                           trend, place=self._center)
        return found and BranchPoint(found.shape, depth=depth, axes=found.axes)

    def batch_ahead(self, before: BranchPoint, depths: Floats) -> list[BranchPoint]:
        """Return the BranchPoints at the first of some depths (k,) that leave no doubt."""
        if self._nested:
            return []
        gripper = before.shape.gripper
        found = ahead(self.simulator, before, depths, _along(self.normal, gripper.rotation),
                      self.normal, gripper.position - self._center, self._center)
        points: list[BranchPoint] = []
        for depth, one in zip(depths.tolist(), found, strict=False):
            before = BranchPoint(one.shape, depth=depth, axes=one.axes).after(before)
            points.append(before)
        return points

    def crossings(self, shapes: HangingShapes, depth: float) -> Crossings:
        """Return where the shapes at `depth` cross the grid of HangingShapes."""
        s = self.simulator.rod.length - depth
        return crossings(shapes, shapes.at(s)[1], self.normal, s)


def ahead(simulator: DirectSimulator, before: BranchPoint, depths: Floats, goals: GoalTable,
          free: Floats, origin: Floats, place: Floats) -> list[Found]:
    """Return what is found at the first of some depths (k,), without roll, that leaves no doubt.

    The goals of a GoalTable are all sought at the depth, but for a ROLL; others as of `follow`.
    """
    mesh, shape, length = before.shape.state.mesh, before.shape, simulator.rod.length
    steps = np.diff(depths, prepend=before.depth)
    far = np.flatnonzero(~(abs(steps) <= LONGEST_STEP * length))
    if far.size:
        depths, steps = depths[:far[0]], steps[:far[0]]
    most, least = without_doubt(steps / length, length)
    if mesh is None or not (len(depths) and shape.stability > least):
        return []
    s = np.where(goals.kind == ROLL, 0.0, (length - depths)[:, None])
    found = follow(
        mesh, shape, goals, s, free, trend=before.trend(depths[0]),
        further=[steps_ahead(last, step) for last, step in pairwise(steps.tolist())],
        origin=origin, place=place, most=most, least=least)
    if simulator.accuracy is not None:
        found = list(takewhile(lambda one: simulator.discretization(
            one.shape.gripper, one.shape) is mesh, found))
    return found


class GivenPoses(SolutionBranch):
    """The equilibria as the gripper goes from pose to pose; the depth is the next one's index.

    `holds` are those at each of the poses.
    """

    what = 'at the pose'
    longest = shortest = np.inf  # the direct simulation makes its own steps
    soft = True

    def __init__(self, simulator: DirectSimulator, poses: Sequence[Pose],
                 holds: Sequence[Holds] | None = None) -> None:
        self.simulator, self.poses = simulator, poses
        self.holds = [()] * len(poses) if holds is None else holds

    def first(self, initial: Shape | None) -> BranchPoint:
        """Return the BranchPoint at the first pose, from a Shape or the natural one."""
        return BranchPoint(self._tracked(0, initial), depth=0.0)

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at the pose of an index, whether the DLO follows there or not."""
        del roll, final
        if depth == before.depth:
            return before
        return BranchPoint(self._tracked(int(depth), before.shape), depth=depth)

    def refusal(self, builder: PlanBuilder, before: BranchPoint | None,
                step: Step) -> Infeasible | None:
        """Return why the DLO does not follow, or None; the amount is what is left to go, m."""
        assert step.point is not None  # each pose has a shape
        shape = step.point.shape
        if not shape.converged:
            left = [pose.position for pose in self.poses[len(builder.waypoints):]]
            inexact = refusal_for_accuracy(self.simulator, builder, shape)
            return inexact or builder.refusal('equilibrium', float(np.linalg.norm(
                np.diff(left, axis=0), axis=1).sum()) if len(left) > 1 else 0.0,
                'no stable shape is found')
        if shape.jumped and builder.waypoints:
            return builder.refusal('continuity', apart(shape, builder.waypoints[-1].shape),
                                   'the DLO would fall into another shape on the way there')
        return None

    def _tracked(self, index: int, initial: Shape | None) -> Shape:
        return self.simulator.track([self.poses[index]], initial=initial,
                                    holds=self.holds[index])[0]


class TwoPoints(SolutionBranch):
    """The shapes that pass both centers, at each depth in the first: x(s2) - x(s1) = P2 - P1.

    The chord (3,) is from the first center to the second, m, the first one is at `center` (3,).
    """

    what = 'that pass both centers'

    def __init__(self, simulator: DirectSimulator, chord: Floats,
                 center: Floats = ORIGIN) -> None:
        self.simulator, self.chord = simulator, np.array(chord, dtype=float)
        self._center = center
        freeze(self.chord)
        self._apart = float(np.linalg.norm(chord))

    def axis(self, shape: Shape) -> Floats:
        """Return the mean of the gripper's axis and the chord."""
        return free_axis(np.array(shape.gripper.rotation), self.chord / self._apart)

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at `depth`, with no roll or a given one."""
        del final
        s1 = self.simulator.rod.length - depth
        found = self._solved(before.shape, POSITION, s1, s1, roll,
                             None if roll else before.trend(depth))
        return None if found is None else BranchPoint(
            found.shape, (float(min(found.where[1], self.simulator.rod.length)),), depth=depth,
            axes=found.axes).after(before)

    def from_end(self, guess: Shape, depth: float) -> BranchPoint | None:
        """Return the BranchPoint whose free end is at the second center, at about a depth (m)."""
        length = self.simulator.rod.length
        found = self._solved(guess, THROUGH, max(length - depth - _AROUND * length, 0.0), length,
                             at=length - depth)
        if found is None or not found.where[0] > 0:
            return None
        s1 = float(found.where[0])
        return BranchPoint(found.shape, (length,), depth=length - s1, axes=found.axes)

    def _solved(self, shape: Shape, first: int, s1: float, s2: float, roll: float = 0.0,
                trend: tuple[Shape, float] | None = None,
                at: float | None = None) -> Found | None:
        """Return the shape that has both goals, the `first` at about `at` (m; None: s1), or None.

        The second one is of the other kind. None as well where the DLO would fall on its way there.
        """
        _, place = shape.frame_at(s1 if at is None else at)
        axis = self.axis(shape)
        found = goal_shape(self.simulator, shape, self._goals(shape, axis, first, roll),
                           (s1, s2, 0.0), axis, trend, shape.gripper.position - place,
                           self._center)
        return found if found is not None and self._is_good(shape, found) else None

    def _goals(self, shape: Shape, axis: Floats, first: int = POSITION,
               roll: float = 0.0) -> GoalTable:
        """Return both places, the `first` of a kind, and a roll about the axis (3,)."""
        length = self.simulator.rod.length
        return GoalTable(
            np.array([first, THROUGH if first == POSITION else POSITION, ROLL]), np.zeros(3),
            np.array([np.zeros(3), self.chord, axis]),
            np.array([np.eye(3), np.eye(3), turned_by(roll * axis) @ shape.gripper.rotation]),
            np.array([1 / length, 1 / length, 1.0]))

    def _is_good(self, before: Shape, found: Found) -> bool:
        """Whether both places are on the DLO, which did not fall on its way there."""
        length = self.simulator.rod.length
        return bool(found.where.max() <= length * (1 + 1e-12) and found.shape.converged
                    and not fell(before, found.shape))

    def batch_ahead(self, before: BranchPoint, depths: Floats) -> list[BranchPoint]:
        """Return the BranchPoints at the first of some depths (k,) that leave no doubt."""
        shape, points = before.shape, []
        _, place = shape.frame_at(self.simulator.rod.length - float(depths[0]))
        found = ahead(self.simulator, before, depths, self._goals(shape, self.axis(shape)),
                      self.chord / self._apart, shape.gripper.position - place, self._center)
        for depth, one in zip(depths.tolist(), found, strict=False):
            if not self._is_good(before.shape, one):
                break
            before = BranchPoint(one.shape, (float(min(one.where[1], one.shape.s[-1])),),
                             depth=depth, axes=one.axes).after(before)
            points.append(before)
        return points

    def crossings(self, shapes: HangingShapes, depth: float) -> Crossings:
        """Return where the shapes at `depth` cross the grid of HangingShapes."""
        s1 = self.simulator.rod.length - depth
        begin, _ = shapes.at(s1)
        away = np.linalg.norm(shapes.positions - begin[:, None], axis=2)
        away[:, shapes.s <= s1] = 0.0
        s2 = _first_above(shapes.s, away, self._apart)
        return self._between(shapes, s1, s2)

    def last_crossings(self, shapes: HangingShapes) -> tuple[Crossings, Floats]:
        """Return the Crossings of the shapes that end in the second center, and depths (m,)."""
        away = np.linalg.norm(shapes.positions - shapes.positions[:, -1:], axis=2)
        s1 = shapes.s[-1] - _first_above(shapes.s[-1] - shapes.s[::-1], away[:, ::-1], self._apart)
        crossed = self._between(shapes, s1, np.full(len(away), shapes.s[-1]))
        a, b = crossed.pairs.T
        return crossed, shapes.s[-1] - ((1 - crossed.shares) * s1[a] + crossed.shares * s1[b])

    def nearest(self, shapes: HangingShapes, depth: float, most: int) -> Floats:
        """Return the frames (k, 3, 3) of the free ends of the stable shapes that miss least.

        That are `most` of them at most, turned about the vertical so that the second center is in
        their direction.
        """
        begin, _ = shapes.at(self.simulator.rod.length - depth)
        chords = shapes.positions - begin[:, None]
        sizes = np.linalg.norm(chords, axis=2)
        sizes[:, shapes.s <= self.simulator.rod.length - depth] = 0.0
        nodes = np.abs(sizes - self._apart).argmin(axis=1)
        chords = chords[np.arange(len(nodes)), nodes]
        up = shapes.up
        height, wanted = chords @ up, float(self.chord @ up)
        aside, across = chords - height[:, None] * up, self.chord - wanted * up
        off = np.hypot(np.linalg.norm(aside, axis=1) - np.linalg.norm(across), height - wanted)
        best = np.argsort(np.where(shapes.stability > 0, off, np.inf))[:most]
        angles = np.arctan2(np.cross(aside[best], across) @ up, aside[best] @ across)
        return np.array([turned_by(angle * up) @ shapes.frames[k, -1]
                         for k, angle in zip(best, angles, strict=True)])

    def least_miss(self, shapes: HangingShapes) -> float:
        """Return the least distance (m) of a free end from the second center, through the first."""
        stable = shapes.stability > 0
        chords = shapes.positions[stable, -1:] - shapes.positions[stable]
        height = chords @ shapes.up
        aside = np.sqrt(np.maximum((chords**2).sum(axis=2) - height**2, 0.0))
        up = float(self.chord @ shapes.up)
        off = np.hypot(aside - np.sqrt(max(self._apart**2 - up**2, 0.0)), height - up)
        return float(off.min(initial=self._apart))

    def _between(self, shapes: HangingShapes, s1: float | Floats, s2: Floats) -> Crossings:
        missing = ~np.isfinite(s1 + s2)
        s1, s2 = (np.where(missing, shapes.s[-1], s) for s in (s1, s2))
        chords = shapes.at(s2)[0] - shapes.at(s1)[0]
        chords[missing] = np.nan
        return crossings(shapes, chords, self.chord, s1)


def _first_above(s: Floats, away: Floats, apart: float) -> Floats:
    """Return (n,) where rows of `away` (n, N + 1), given at `s`, first exceed `apart`; else nan."""
    k = np.argmax(away >= apart, axis=1)
    rows = np.arange(len(away))
    low, high = away[rows, k - 1], away[rows, k]
    crossed = (k > 0) & (high >= apart)
    share = (apart - low) / np.where(high > low, high - low, 1.0)
    return np.where(crossed, s[k - 1] + share * (s[k] - s[k - 1]), np.nan)


def _along(normal: Floats, reference: Floats) -> GoalTable:
    """Return the goals of a tangent, without a roll since `reference`; arc lengths to be filled."""
    reference = np.array(reference, order='C')
    return GoalTable(np.array([DIRECTION, ROLL]), np.zeros(2),
                     np.array([normal, free_axis(reference, normal)]),
                     np.array([reference, reference]), np.ones(2))
