# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Insertion into a bore of about the DLO's own diameter (Zheng et al. 1991; paper, section 5.2).

The walls of the bore carry the part inside. The part outside hangs as though the DLO was cut off at
the entrance, with its end in the bore's direction: it transmits neither force nor moment to the
entrance. So the bore bears only the weight of the part inside and, if the DLO is naturally bent,
the moment that keeps it straight (`Plan.bore_moment`). The roll of the DLO in the bore stays
constant, so that nothing rubs. With a uniform DLO the gripper then travels along the curve of the
first shape; in general each depth is the beginning of a threading with a shorter DLO.

When a mass comes to the entrance, the bore would carry it at once, and the gripper would have to
jump. There the plan stays at one depth while the entrance takes over the weight, part by part.

A DLO that is too soft for that may hang obliquely into a bore that is wide and short, and touch
nothing: then nothing carries it. Where half of what is inside is in the middle of the bore, its
tilt a leaves room as long as depth sin(a) < 2 (R - r). That is a passage through a sheet as thick
as the bore is deep, at half the depth, moved on along the bore by the other half.
"""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.continuation import (
    BranchPoint,
    Follower,
    SolutionBranch,
    Step,
    continue_branch,
)
from dlo_planner.inverse.equilibria import (
    Candidate,
    least_turn,
    shape_with_end,
    start_candidates,
)
from dlo_planner.inverse.held_inside import HeldInside
from dlo_planner.inverse.route import NO_WAY, first_feasible
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.inverse.waypoint_newton import goal_shape
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import BORE, Hold
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose, shifted
from dlo_planner.model.rod import Rod, Surface, before
from dlo_planner.model.value import put
from dlo_planner.plan.bore import insertion_force
from dlo_planner.plan.builder import PlanBuilder, refusal_for_accuracy, refusal_for_leap
from dlo_planner.plan.continuity import gripper_motion
from dlo_planner.plan.goal_rows import ROTATION, GoalTable
from dlo_planner.plan.plan import FOUND, Plan
from dlo_planner.plan.waypoint import Holes, Waypoint, waypoint_at
from dlo_planner.progress import uninterrupted

_PACE = 0.1       # rad plus part of the length: a longer step of a take-over is made in parts
_NOTHING = 0.01   # the same: a step that is no step
_LEAST_PART = 1 / 512  # of the masses: what jumps in so small a part of a take-over jumps in any
_PAUSE = 0.005    # of the length: the way that a part of a take-over counts as
_AT_END = 1e-12   # of the length


class _Stop(NamedTuple):
    """A depth, m, and the part of the masses at the entrance that the entrance carries there."""

    depth: float
    carried: float


class Insertion(SolutionBranch):
    """The shapes outside a bore, free of force at its entrance, where their frame is `end` (3, 3).

    The depth of this SolutionBranch is a path length in m: it goes on while the entrance takes over
    a mass.
    """

    what = 'free of force at the bore entrance'
    longest = 1.0  # no shape is needed to find the next one; `too_far` makes steps shorter

    def __init__(self, simulator: DirectSimulator, bore: CutOut, end: Floats,
                 depths: Floats) -> None:
        self.simulator, self._bore = simulator, bore
        self._end = np.array(end, order='C')
        self._goals = GoalTable(np.array([ROTATION]), np.zeros(1), np.zeros((1, 3)),
                                self._end[None], np.ones(1))
        self._stops = self._stops_at(depths)
        least = _PAUSE * simulator.rod.length
        self.way = np.cumsum([0.0, *(max(other.depth - one.depth, least * (one != other))
                                     for one, other in pairwise(self._stops))])
        self.depths = np.array([depth for depth, _ in self._stops])

    def first(self) -> BranchPoint | None:
        """Return the BranchPoint with which the way begins, or None."""
        return self._point(0.0, True)

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at a way, m; a waypoint is confirmed, its end at the entrance."""
        del roll
        return before if depth == before.depth and final else self._point(
            depth, final, before)

    def _point(self, way: float, final: bool,
               before: BranchPoint | None = None) -> BranchPoint | None:
        k = min(int(np.searchsorted(self.way, way, side='right')) - 1, len(self._stops) - 1)
        stop = self._stops[k]
        if way > self.way[k]:
            share, other = (way - self.way[k]) / (self.way[k + 1] - self.way[k]), self._stops[k + 1]
            stop = _Stop(stop.depth + share * (other.depth - stop.depth), 0.0
                         if other.depth > stop.depth else
                         stop.carried + share * (other.carried - stop.carried))
        outside = self.simulator.with_rod(self._rod(stop))
        shape = self._shape(outside)
        if shape is None:
            return None
        point = BranchPoint(shape, depth=way)
        if not final or before is not None and self.too_far(before, point, way - before.depth):
            return point  # what is too far from the one before is no waypoint
        return BranchPoint(self._held(stop, outside, shape), depth=way)

    def _shape(self, outside: DirectSimulator) -> Shape | None:
        """Return the Shape of the part outside, free of force at its end, or None."""
        found = goal_shape(outside, shape_with_end(outside.mesh, self._end), self._goals,
                           outside.rod.length, place=self._bore.center)
        return found and found.shape

    def _held(self, stop: _Stop, outside: DirectSimulator, shape: Shape) -> Shape:
        """Return a Shape with its end held by the bore.

        That makes it more stable; without a mass at the entrance the bore exerts no force. It also
        bears the weight of a mass along its axis.
        """
        depth, carried = stop
        if not depth and not carried:
            return shape
        if carried:  # a start for the DLO with the whole mass, no more
            outside = self.simulator.with_rod(self._rod(_Stop(depth, 0.0)))
            shape = replace(shape, state=shape.state.forgotten())
        entrance = Hold(Pose.from_rotation(self._bore.center, shape.frames[-1]),
                     'clamped' if carried else 'sleeve', by=BORE)
        return outside.solve(shape.gripper, shape, far_end=entrance)

    def _stops_at(self, depths: Floats) -> list[_Stop]:
        """Return all stops between the first and the last of `depths` (n,)."""
        rod = self.simulator.rod
        at_tip = {0.0} if rod.tip_mass else set()
        masses = sorted(at_tip | {rod.length - s for s, mass in rod.point_masses if mass})
        stops = [_Stop(float(depths[0]), 0.0)]
        first = None if depths[0] else self._shape(self.simulator)
        # where it is refused no take-over matters
        if not depths[0] and (first is None or first.stability < -NEUTRAL):
            return [_Stop(float(depth), 0.0) for depth in depths]
        for target in depths[1:]:
            for at in masses:
                if stops[-1].depth <= at < target:
                    parts = self._parts(_Stop(at, 0.0), _Stop(at, 1.0))
                    stops += [_Stop(at, 0.0)] * (len(parts) > 0 and at > stops[-1].depth) + parts
            stops.append(_Stop(float(target), 0.0))
        return stops

    def _parts(self, one: _Stop, other: _Stop) -> list[_Stop]:
        """Return the stops after `one` in which to go to `other` at the same depth."""
        begin, end = (self._shape(self.simulator.with_rod(self._rod(stop)))
                      for stop in (one, other))
        apart = 0.0 if begin is None or end is None else gripper_motion(
            begin.gripper, end.gripper, self.simulator.rod.length)
        if apart < _NOTHING and (one.carried, other.carried) == (0.0, 1.0):
            return []
        if apart < _PACE or other.carried - one.carried < _LEAST_PART:  # a jump: it is refused
            return [other]
        middle = _Stop(one.depth, 0.5 * (one.carried + other.carried))
        return self._parts(one, middle) + self._parts(middle, other)

    def _rod(self, stop: _Stop) -> Rod:
        """Return the Rod outside at a stop, without the masses that the entrance carries."""
        depth, carried = stop
        whole = self.simulator.rod
        end = whole.length - depth
        for s, _ in whole.point_masses:
            if abs(s - end) <= _AT_END * whole.length:
                end = s
        return before(whole, end, carried)

    def too_far(self, before: BranchPoint, after: BranchPoint, step: float) -> float:
        """Return by how much (m) a step is longer than one that needs no look between."""
        length = self.simulator.rod.length
        return length * max(0.0, gripper_motion(before.shape.gripper, after.shape.gripper, length)
                            - _PACE)

    def replayed(self, last: Shape | None, point: BranchPoint) -> BranchPoint:
        """Return the BranchPoint: the shape before is of another DLO."""
        return point

    def refusal(self, builder: PlanBuilder, before: BranchPoint | None,
                step: Step) -> Infeasible | None:
        """Return why a Step does not lead to a shape in which the DLO stays, or None."""
        if step.point is None:
            return super().refusal(builder, before, step)
        shape = step.point.shape
        if shape.stability < -NEUTRAL:
            return builder.refusal('stability', -shape.stability, 'the DLO would not stay in the '
                                   f'shape; stability {shape.stability:.3g}', '')
        if not shape.converged:
            inexact = refusal_for_accuracy(self.simulator, builder, shape)
            return inexact or builder.refusal(
                'equilibrium', builder.step, 'the equilibrium was not found exactly: residual '
                f'{shape.residual:.3g}, off the bore entrance by {shape.violation:.3g} m')
        if shape.jumped:
            off = float(np.linalg.norm(shape.positions[-1] - self._bore.center))
            return builder.refusal('continuity', off, 'the DLO would fall out of the shape that is '
                                   f'free of force at the bore entrance, its end {off:.3g} m off')
        begins = before is None and not shape.holds
        return refusal_for_leap(self.simulator.with_rod(shape.rod), builder,
                                shape) if begins and shape.rod is not None else None


_INSERTED = 0.99  # of the length, at most
# rad: where the mouth allows a smaller tilt at the last depth, none is looked for. Of 58 soft DLOs
# that bores of 1.02 to 1.2 diameters refuse, the mouth might allow one, and that has no way in
_TILTED = 0.05
_BLOCK = 4.0      # of the length: how far the block around a bore reaches


@dataclass(frozen=True, eq=False, repr=False)
class Insert(Task):
    """Insert into a bore of about the DLO's diameter; see `InverseSimulator.insert`.

    Attributes
    ----------
    bore : CutOut
        Its center is that of the entrance, its normal points inwards; its radius is that of the
        bore.
    depths : ndarray, shape (n,) or None
        Arc lengths that are inside, m. If None, chosen by the solver.
    friction : float or None
        Coulomb's coefficient in the bore. If None, not known: `Plan.insertion_force` is nan, its
        status 'not looked at'.
    hold_at : float or None
        Where the gripper holds the DLO, m from its beginning. If None, at its beginning.
    max_misalignment : float or None
        Largest angle against the bore at which the DLO may go in, rad, where it cannot along the
        bore: it then hangs into a bore that is wide for its depth, and touches nothing. With 0 it
        goes in along the bore, or the task is refused. If None, any. Not of a DLO that is held
        inside, nor of a bore without a radius.
    """

    hangs_after: ClassVar[bool] = False
    deepest: ClassVar[float | None] = 0.99

    bore: CutOut
    depths: Floats | None = None
    friction: float | None = None
    hold_at: float | None = None
    max_misalignment: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, bore: CutOut, depths: ArrayLike | None = None,
                     friction: float | None = None, hold_at: float | None = None,
                     max_misalignment: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('bore', self.bore, CutOut)
        put(self, depths=depths_or_none('depths', self.depths))
        if self.friction is not None:
            put(self, friction=number('friction', self.friction, minimum=0))
        if self.hold_at is not None:
            put(self, hold_at=number('hold_at', self.hold_at, minimum=0) or None)
        if self.max_misalignment is not None:
            put(self, max_misalignment=number('max_misalignment', self.max_misalignment, minimum=0,
                                              maximum=np.pi / 2, unit='rad'))
            if self.max_misalignment and self.hold_at is not None:
                raise InvalidTask(f'max_misalignment = {self.max_misalignment:g}: expected None or '
                                  '0 with hold_at, a DLO that is held inside goes in along the '
                                  'bore')
        super().__post_init__()

    @property
    def held_inside(self) -> float | None:
        """Where the gripper holds the DLO inside, m; None: at its beginning."""
        return self.hold_at

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        if self.hold_at is None:
            try:
                return self._inserted(context)
            except Infeasible as error:
                if error.constraint not in NO_WAY:
                    raise
                return self._oblique(context, error)
        inside = HeldInside(context, self.hold_at, (self.bore,))
        return inside.planned(partial(self._inserted, inside.front))

    def _oblique(self, context: PlanContext, refused: Infeasible) -> Plan:
        """Return the Plan of a DLO that hangs into a wide bore, or raise why there is none."""
        rod, bore = context.rod, self.bore
        depths = depths_on(rod.length, self.depths)
        deep, surface = float(depths[-1]), Surface.of(rod)
        if bore.radius is None or self.max_misalignment == 0 or not deep or (
                2 * (bore.radius - surface.bound) < deep * np.sin(_TILTED)):
            raise refused
        # seen from the middle of what is inside: no deeper than the bore is from there
        block = Sheet(bore.pose, _BLOCK * rod.length, _BLOCK * rod.length, deep, (bore,))
        try:
            passed = Thread(bore, 0.5 * depths, max_misalignment=self.max_misalignment).solve(
                replace(context, simulator=context.simulator.with_obstacles([block]),
                        progress=context.progress.silent(), requirements=replace(
                            context.requirements, workspace=None)))
        except Infeasible as error:
            refused.args = (f'{refused}; obliquely: {error}',)
            raise refused from None
        middle = CutOut(shifted(bore.pose, 0.5 * deep * bore.normal), radius=bore.radius)
        around = Sheet(middle.pose, block.width, block.height, deep, (middle,))
        builder = PlanBuilder(depths, context.demands)
        holes = Holes([middle], rod.length, [around], surface)
        for depth, shape in zip(depths.tolist(), passed.shapes, strict=True):
            half = 0.5 * depth
            builder.check()
            builder.add(holes.passed(waypoint_at(
                carried(shape, half * bore.normal), bore.center + half * bore.normal,
                rod.length - half, bore.normal)))
        return replace(builder.finished(), insertion_force=np.zeros(depths.size),
                       insertion_status=(FOUND,) * depths.size)

    def _inserted(self, context: PlanContext) -> Plan:
        """Return the Plan of a DLO that is held at its beginning."""
        depths = depths_on(context.rod.length, self.depths)
        if depths[-1] > _INSERTED * context.rod.length:
            raise InvalidTask(f'depths[{len(depths) - 1}] = {depths[-1]:g}: expected at most '
                              f'{_INSERTED:g} of the length')
        if context.simulator.surroundings.point_loads:
            raise InvalidTask('simulator.point_loads: expected none for an insertion, a part of '
                              'the DLO is in the bore')
        bore, demands, simulator = self.bore, context.demands, context.without_obstacles
        holes = Holes([bore], simulator.rod.length, demands.obstacles, demands.surface)

        def waypoint(point: BranchPoint) -> Waypoint:
            shape = point.shape
            return holes.passed(waypoint_at(shape, bore.center, shape.s[-1], bore.normal))

        def planned(begin: Candidate) -> Plan:
            demands.progress.check()
            end = np.array(begin.shape.frames[-1])  # of a series, about along the bore
            branch = Insertion(simulator, bore, least_turn(end[:, 0], bore.normal) @ end, depths)
            builder = PlanBuilder(branch.depths, demands)
            continue_branch(builder, Follower(branch, branch.first(), 0.0, branch.way), waypoint)
            return builder.finished()

        plan = first_feasible(partial(planned, begin) for begin in start_candidates(
            simulator, bore.normal, context.start))
        pushes = [uninterrupted(insertion_force(simulator, bore, self.friction, depth, shape))
                  for depth, shape in zip(plan.depths, plan.shapes, strict=True)]
        return replace(plan, insertion_force=np.array([push.force for push in pushes]),
                       insertion_status=tuple(push.status for push in pushes))
