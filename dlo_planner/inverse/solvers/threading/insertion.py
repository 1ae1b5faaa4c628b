# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Insertion into a bore of about the DLO's own diameter (Zheng et al. 1991; paper, section 5.2).

The walls of the bore carry what is inside. What is outside hangs as though it were cut off at the
mouth, with its end there in the bore's direction: it transmits neither force nor moment to the
mouth, so that the bore bears only what the part inside makes of itself: its weight, and where it is
naturally bent the moment that keeps it straight (`Plan.bore_moment`). The roll of the DLO in the
bore stays, so that nothing rubs. For a uniform DLO the gripper then travels along the curve of its
shape at the beginning; in general it is the beginning of a threading with a shorter DLO at every
depth.

A mass that comes to the mouth would be carried by the bore at once, and the gripper would have to
leap. There the plan stays at one depth while the mouth takes over the weight, part by part.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.solvers.hanging.marching import hanging
from dlo_planner.inverse.solvers.hanging.start_candidates import start_candidates, with_free_end
from dlo_planner.inverse.solvers.points.one_point import aligned_shape
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.part import before
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.clearance import sheet_of
from dlo_planner.plan.continuity import gripper_motion, refusal_for_leap
from dlo_planner.plan.waypoint import waypoint_at

_ELEMENTS = 64
_PACE = 0.1       # rad plus part of the length: a longer step is looked at, or made in parts
_NOTHING = 0.01   # the same: a step that is no step
_HALVINGS = 12
_AT_END = 1e-12   # of the length


def insert(simulator, bore, depths, start, brief):
    """Return the Plan; see `InverseSimulator.insert`."""
    refused = None
    for first, *_ in start_candidates(simulator, bore, start):
        brief.progress.check()
        try:
            return _Insertion(simulator, bore, first.frames[-1], brief).plan(depths)
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    raise refused


class _Insertion:
    """The insertion of a DLO that has the frame `end` (3, 3) at the mouth.

    A stop is (depth in m, part of the masses at the mouth that the mouth carries).
    """

    def __init__(self, simulator, bore, end, brief):
        self.simulator, self.bore, self.brief = simulator, bore, brief
        self.end = np.array(end, order='C')
        self.sheet = sheet_of(bore, simulator.rod.length, brief.obstacles)

    def plan(self, depths):
        """Return the Plan; raise Infeasible."""
        first = float(depths[0]), 0.0
        shape = self._shape(first, PlanBuilder(depths, self.brief),
                            0.0)  # before anything else is done
        stops = self._stops(depths)
        draft = PlanBuilder([depth for depth, _ in stops], self.brief)
        for index, stop in enumerate(stops):
            if index:
                shape = self._shape(stop, draft, stops[index - 1][0])
                self._check_step(stops[index - 1], stop, shape, draft)
            waypoint = waypoint_at(shape, self.bore.center, shape.s[-1], self.bore.normal)
            draft.add(waypoint.with_clearances([self.bore], [self.sheet], self.brief.surface))
        return draft.finished()

    def _stops(self, depths):
        """Return all stops on the way through `depths` (n,)."""
        rod = self.simulator.rod
        masses = {0.0} if rod.tip_mass else set()
        masses = sorted(masses | {rod.length - s for s, mass in rod.point_masses if mass})
        stops = [(float(depths[0]), 0.0)]
        for wanted in depths[1:]:
            for at in masses:
                if not stops[-1][0] <= at < wanted:
                    continue
                parts = self._parts((at, 0.0), (at, 1.0))
                stops += [(at, 0.0)] * (len(parts) > 0 and at > stops[-1][0]) + parts
            stops.append((float(wanted), 0.0))
        return stops

    def _parts(self, one, other):
        """Return the stops after `one` in which to go to `other` at the same depth."""
        apart = gripper_motion(self._gripper(one), self._gripper(other), self.simulator.rod.length)
        if apart < _NOTHING and other[1] == 1.0 and one[1] == 0.0:
            return []
        if apart < _PACE:
            return [other]
        middle = (one[0], 0.5 * (one[1] + other[1]))
        return self._parts(one, middle) + self._parts(middle, other)

    def _rod(self, stop):
        """Return the Rod outside at a stop, less what the mouth carries of masses at its end."""
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

    def _gripper(self, stop):
        """Return about the gripper's Pose at a stop: one march from the mouth."""
        self.brief.progress.check()
        rod = self._rod(stop)
        mesh = Discretization(replace(self.simulator.surroundings, rod=rod),
                              np.linspace(0, rod.length, _ELEMENTS + 1), 'local', 0)
        state, base = hanging(mesh.system(self.end), self.end)
        return Pose.from_rotation(self.bore.center - state.positions[-1], base)

    def _shape(self, stop, draft, reached):
        """Return the Shape at a stop, confirmed with its end at the mouth; raise Infeasible."""
        depth, carried = stop
        outside = self.simulator.with_rod(self._rod(stop))
        guess = with_free_end(outside, self.end)
        shape = aligned_shape(outside, guess, outside.rod.length, self.bore.normal,
                              guess.gripper.rotation)
        if shape is None:
            raise draft.refusal('equilibrium', depth - reached,
                                'no equilibrium is free of force at the mouth')
        shape = shape.moved(self.bore.center - shape.positions[-1])
        if depth or carried:
            # the bore holds the end, which makes it more stable; without a mass at the mouth that
            # has to cost nothing. The weight of a mass it bears along its axis as well.
            mouth = FarEnd(Pose.from_rotation(self.bore.center, shape.frames[-1]),
                           'clamped' if carried else 'sleeve')
            if carried:  # a start for the DLO with the whole mass, no more
                outside = self.simulator.with_rod(self._rod((depth, 0.0)))
                shape = replace(shape, state=shape.state.forgotten())
            shape = outside.solve(shape.gripper, shape, far_end=mouth)
        if not shape.converged:
            raise _unconverged(draft, shape, depth - reached)
        refusal = refusal_for_leap(outside, draft, shape) if not draft.waypoints and not (
            depth or carried) else None
        if refusal is not None:
            raise refusal
        return shape

    def _check_step(self, one, other, shape, draft):
        """Raise Infeasible if the gripper has to leap from a stop to another with `shape`.

        It leaps if the longer half of a step, halved again and again, does not get shorter.
        """
        length = self.simulator.rod.length
        if gripper_motion(draft.last.gripper, shape.gripper, length) < _PACE:
            return
        (low, carried), (high, _) = one, other
        poses = [self._gripper(one), self._gripper(other)]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            between = self._gripper((middle, carried if middle == low else 0.0))
            here, there = (gripper_motion(one, between, length) for one in poses)
            if here > there:
                high, poses[1] = middle, between
            else:
                low, poses[0] = middle, between
            if gripper_motion(*poses, length) < _NOTHING:
                return
        turn = angle_between(*(pose.rotation for pose in poses))
        raise draft.refusal('continuity', turn * shape.s[-1], 'the gripper would have to turn by '
                            f'{turn:.3g} rad at once at depth {high:g} m; closer waypoints do not '
                            'help')


def _unconverged(draft, shape, missing):
    """Return Infeasible: why a Shape that was looked for is not one that the DLO stays in."""
    if shape.stability < -NEUTRAL:
        return draft.refusal('stability', -shape.stability, 'the DLO would not stay in the shape; '
                             f'stability {shape.stability:.3g}')
    return draft.refusal('equilibrium', missing, 'the equilibrium was not found exactly: residual '
                         f'{shape.residual:.3g}, off the mouth by {shape.violation:.3g} m')
