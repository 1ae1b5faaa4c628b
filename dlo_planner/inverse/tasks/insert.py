# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Insertion into a bore of about the DLO's own diameter (Zheng et al. 1991; paper, section 5.2).

The walls of the bore carry the part inside. The part outside hangs as though the DLO was cut off at
the mouth, with its end in the bore's direction: it transmits neither force nor moment to the mouth.
So the bore bears only the weight of the part inside and, if the DLO is naturally bent, the moment
that keeps it straight (`Plan.bore_moment`). The roll of the DLO in the bore stays constant, so that
nothing rubs. With a uniform DLO the gripper then travels along the curve of the first shape; in
general each depth is the beginning of a threading with a shorter DLO.

When a mass comes to the mouth, the bore would carry it at once, and the gripper would have to leap.
There the plan stays at one depth while the mouth takes over the weight, part by part.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.continuation import aligned_shape
from dlo_planner.inverse.equilibria import hanging, start_candidates, with_free_end
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.rod import Rod, before
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import put
from dlo_planner.plan.bore import insertion_force
from dlo_planner.plan.builder import PlanBuilder, refusal_for_leap
from dlo_planner.plan.checks import Judge
from dlo_planner.plan.continuity import gripper_motion
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Holes, waypoint_at

_ELEMENTS = 64
_PACE = 0.1       # rad plus part of the length: a longer step is examined, or made in parts
_NOTHING = 0.01   # the same: a step that is no step
_HALVINGS = 12
_AT_END = 1e-12   # of the length


def insert(simulator: DirectSimulator, bore: CutOut, depths: Floats, start: Pose | None,
           demands: Judge) -> Plan:
    """Return the Plan; see `InverseSimulator.insert`."""
    refused: Infeasible | None = None
    for first, *_ in start_candidates(simulator, bore, start):
        demands.progress.check()
        try:
            return _Insertion(simulator, bore, first.frames[-1], demands).plan(depths)
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    assert refused is not None  # there is a candidate at least
    raise refused


class _Stop(NamedTuple):
    """A depth, m, and the part of the masses at the mouth that the mouth carries there."""

    depth: float
    carried: float


class _Insertion:
    """The insertion of a DLO that has the frame `end` (3, 3) at the mouth."""

    def __init__(self, simulator: DirectSimulator, bore: CutOut, end: Floats,
                 demands: Judge) -> None:
        self.simulator, self.bore, self.demands = simulator, bore, demands
        self.end = np.array(end, order='C')
        self.holes = Holes([bore], simulator.rod.length, demands.obstacles, demands.surface)

    def plan(self, depths: Floats) -> Plan:
        """Return the Plan; raise Infeasible."""
        first = _Stop(float(depths[0]), 0.0)
        shape = self._shape(first, PlanBuilder(depths, self.demands),
                            0.0)  # before anything else is done
        stops = self._stops(depths)
        builder = PlanBuilder(np.array([depth for depth, _ in stops]), self.demands)
        for index, stop in enumerate(stops):
            if index:
                shape = self._shape(stop, builder, stops[index - 1][0])
                self._check_step(stops[index - 1], stop, shape, builder)
            waypoint = waypoint_at(shape, self.bore.center, shape.s[-1], self.bore.normal)
            builder.add(self.holes.passed(waypoint))
        return builder.finished()

    def _stops(self, depths: Floats) -> list[_Stop]:
        """Return all stops between the first and the last of `depths` (n,)."""
        rod = self.simulator.rod
        at_tip = {0.0} if rod.tip_mass else set()
        masses = sorted(at_tip | {rod.length - s for s, mass in rod.point_masses if mass})
        stops = [_Stop(float(depths[0]), 0.0)]
        for target in depths[1:]:
            for at in masses:
                if not stops[-1][0] <= at < target:
                    continue
                parts = self._parts(_Stop(at, 0.0), _Stop(at, 1.0))
                stops += [_Stop(at, 0.0)] * (len(parts) > 0 and at > stops[-1][0]) + parts
            stops.append(_Stop(float(target), 0.0))
        return stops

    def _parts(self, one: _Stop, other: _Stop) -> list[_Stop]:
        """Return the stops after `one` in which to go to `other` at the same depth."""
        apart = gripper_motion(self._gripper(one), self._gripper(other), self.simulator.rod.length)
        if apart < _NOTHING and other.carried == 1.0 and one.carried == 0.0:
            return []
        if apart < _PACE:
            return [other]
        middle = _Stop(one.depth, 0.5 * (one.carried + other.carried))
        return self._parts(one, middle) + self._parts(middle, other)

    def _rod(self, stop: _Stop) -> Rod:
        """Return the Rod outside at a stop, without the masses that the mouth carries."""
        depth, carried = stop
        whole = self.simulator.rod
        end = whole.length - depth
        for s, _ in whole.point_masses:
            if abs(s - end) <= _AT_END * whole.length:
                end = s
        rod = before(whole, end)
        if not carried:
            return rod
        masses = tuple((s, mass * (1 - carried if s == end else 1)) for s, mass in rod.point_masses)
        return replace(rod, tip_mass=rod.tip_mass * (1 - carried), point_masses=masses)

    def _gripper(self, stop: _Stop) -> Pose:
        """Return about the gripper's Pose at a stop, by one integration from the mouth."""
        self.demands.progress.check()
        rod = self._rod(stop)
        mesh = Discretization(replace(self.simulator.surroundings, rod=rod),
                              np.linspace(0, rod.length, _ELEMENTS + 1), 'local', 0)
        state, base = hanging(mesh.system(self.end), self.end)
        return Pose.from_rotation(self.bore.center - state.positions[-1], base)

    def _shape(self, stop: _Stop, builder: PlanBuilder, reached: float) -> Shape:
        """Return the Shape at a stop, confirmed with its end at the mouth; raise Infeasible."""
        depth, carried = stop
        outside = self.simulator.with_rod(self._rod(stop))
        guess = with_free_end(outside, self.end)
        found = aligned_shape(outside, guess, outside.rod.length, self.bore.normal,
                              guess.gripper.rotation)
        if found is None:
            raise builder.refusal('equilibrium', depth - reached,
                                  'no equilibrium is free of force at the mouth')
        shape = found.shape.moved(self.bore.center - found.shape.positions[-1])
        if depth or carried:
            # the bore holds the end, which makes the shape more stable; without a mass at the mouth
            # that takes no force. It also bears the weight of a mass along its axis.
            mouth = FarEnd(Pose.from_rotation(self.bore.center, shape.frames[-1]),
                           'clamped' if carried else 'sleeve')
            if carried:  # a start for the DLO with the whole mass, no more
                outside = self.simulator.with_rod(self._rod(_Stop(depth, 0.0)))
                shape = replace(shape, state=shape.state.forgotten())
            shape = outside.solve(shape.gripper, shape, far_end=mouth)
        if not shape.converged:
            raise _unconverged(builder, shape, depth - reached)
        refusal = refusal_for_leap(outside, builder, shape) if not builder.waypoints and not (
            depth or carried) else None
        if refusal is not None:
            raise refusal
        return shape

    def _check_step(self, one: _Stop, other: _Stop, shape: Shape, builder: PlanBuilder) -> None:
        """Raise Infeasible if the gripper has to leap from a stop to another with `shape`.

        It leaps if the longer half of a step does not get shorter by repeated halving.
        """
        length = self.simulator.rod.length
        if gripper_motion(builder.waypoints[-1].shape.gripper, shape.gripper, length) < _PACE:
            return
        (low, carried), (high, _) = one, other
        near, far = self._gripper(one), self._gripper(other)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            between = self._gripper(_Stop(middle, carried if middle == low else 0.0))
            if gripper_motion(near, between, length) > gripper_motion(far, between, length):
                high, far = middle, between
            else:
                low, near = middle, between
            if gripper_motion(near, far, length) < _NOTHING:
                return
        turn = angle_between(near.rotation, far.rotation)
        raise builder.refusal('continuity', turn * shape.s[-1], 'the gripper would have to turn by '
                              f'{turn:.3g} rad at once at depth {high:g} m; closer waypoints do '
                              'not help')


def _unconverged(builder: PlanBuilder, shape: Shape, missing: float) -> Infeasible:
    """Return Infeasible, with the reason why the DLO does not stay in a Shape."""
    if shape.stability < -NEUTRAL:
        return builder.refusal('stability', -shape.stability, 'the DLO would not stay in the '
                               f'shape; stability {shape.stability:.3g}')
    return builder.refusal('equilibrium', missing, 'the equilibrium was not found exactly: '
                           f'residual {shape.residual:.3g}, off the mouth by '
                           f'{shape.violation:.3g} m')


_INSERTED = 0.99  # of the length, at most


@dataclass(frozen=True, eq=False, repr=False)
class Insert(Task):
    """Insert into a bore of about the DLO's diameter; see `InverseSimulator.insert`.

    Attributes
    ----------
    bore : CutOut
        Its center is that of the mouth, its normal points inwards; its radius is that of the bore.
    depths : ndarray, shape (n,) or None
        Arc lengths that are inside, m. If None, chosen by the solver.
    friction : float or None
        Coulomb's coefficient in the bore. If None, not known: `Plan.insertion_force` is nan.
    """

    bore: CutOut
    depths: Floats | None = None
    friction: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, bore: CutOut, depths: ArrayLike | None = None,
                     friction: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('bore', self.bore, CutOut)
        put(self, depths=depths_or_none('depths', self.depths))
        if self.friction is not None:
            put(self, friction=number('friction', self.friction, minimum=0))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        depths = depths_on(context.rod.length, self.depths)
        if depths[-1] > _INSERTED * context.rod.length:
            raise InvalidTask(f'depths[{len(depths) - 1}] = {depths[-1]:g}: expected at most '
                              f'{_INSERTED:g} of the length')
        if context.simulator.surroundings.point_loads:
            raise InvalidTask('simulator.point_loads: expected none for an insertion, a part of '
                              'the DLO is in the bore')
        plan = insert(context.without_obstacles, self.bore, depths, context.start, context.demands)
        return replace(plan, insertion_force=np.array([
            insertion_force(context.without_obstacles, self.bore, self.friction, depth, shape)
            for depth, shape in zip(plan.depths, plan.shapes, strict=True)]))
