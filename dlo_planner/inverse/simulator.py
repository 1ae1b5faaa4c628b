# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The inverse simulator: from a task to gripper poses."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.deprecated import renamed, renamed_arguments
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.solvers.contact.hold_and_slide import (
    CONDITIONS,
    hold_contact,
    slide_contact,
)
from dlo_planner.inverse.solvers.contact.straight import slide_straight
from dlo_planner.inverse.solvers.search import PenaltyResult, minimize_penalty
from dlo_planner.inverse.solvers.threading.approach import approach
from dlo_planner.inverse.solvers.threading.deepest import deepest
from dlo_planner.inverse.solvers.threading.insertion import insert
from dlo_planner.inverse.solvers.threading.one_cutout import thread, trim_to_clearance
from dlo_planner.inverse.solvers.threading.sequence import thread_sequence
from dlo_planner.inverse.solvers.threading.two_cutouts import thread_two
from dlo_planner.model.checks import choice, flag, instance, items, number, row
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import Value, freeze, put
from dlo_planner.model.value import brief as one_line
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements, kept_between
from dlo_planner.plan.plan import Plan, Waypoint
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import OnProgress, Progress

_WAYPOINTS = 40
_MOST = 10_000  # waypoints of a plan, or forces
_DEEPEST = 0.95  # of the length, where no depths are given
_INSERTED = 0.99
_FASTEST = 1e6   # lengths of the DLO and rad per s: times of a plan have to differ
_FARTHEST = 100  # of the length: from where a start phase may come


class InverseSimulator(Value):
    """Finds the gripper poses that make the DLO's shape do a task.

    Args:
        simulator: the DirectSimulator whose rod, gravity and discretization are used. A permanent
            set that it starts with counts. Its obstacles are touched by the contact tasks and
            avoided by the others; a Sheet among them is the one around a cut-out that it has.
        workspace: Workspace, where the gripper may be; None: anywhere
        allow_plastic: whether a plan may bend the DLO beyond its yield limits. Planning itself is
            elastic: `replay` with `simulator` shows the set that remains.

    A waypoint that leaves the workspace, touches what it should not, bends more sharply than
    `Rod.max_bend_curvature`, or yields though it must not, is refused: `Infeasible` names the
    waypoint, the constraint and the amount. Workspace and contacts are looked at between waypoints
    as well, on the path that `Trajectory` takes: there the waypoint is the next one. Not looked at
    is the DLO between the waypoints of contact tasks and of `insert`, whose shapes are of parts.
    Where a task leaves a choice, it is made so as to keep them.
    """

    PARTS = ('simulator', 'workspace', '_yield_limits', '_without_obstacles', '_given')

    @renamed_arguments(may_yield='allow_plastic')
    def __init__(self, simulator: DirectSimulator, *, workspace: Workspace | None = None,
                 allow_plastic: bool = True):
        clamping('simulator', simulator)
        instance('workspace', workspace, Workspace, optional=True)
        if simulator.method != 'newton':
            raise InvalidTask(f'simulator.method = {simulator.method!r}: expected \'newton\', '
                              'which plans are made with')
        if simulator.surroundings.has_moments:
            raise InvalidTask('simulator.point_loads: expected forces alone where plans are made, '
                              'dead moments have no potential')
        put(self, _given=simulator)
        yield_limits = None
        if not flag('allow_plastic', allow_plastic) and simulator.rod.yields:
            rod = simulator.rod
            yield_limits = np.array([rod.yield_torsion or np.inf,
                                 *(rod.yield_curvature or (np.inf, np.inf))])
        put(self, simulator=simulator.elastic(), workspace=workspace, _yield_limits=yield_limits)
        put(self, _without_obstacles=self.simulator.without_obstacles())
        freeze(yield_limits)

    def __repr__(self):
        return one_line(self, repr(self.simulator), '' if self.workspace is None else
                     repr(self.workspace))

    def thread(self, cutout: CutOut, *, start: Pose | None = None, initial: Shape | None = None,
               depths: ArrayLike | None = None, method: str = 'coupled',
               gripper_clearance: float | None = None, as_deep_as_possible: bool = False,
               linear_speed: float = 0.1, angular_speed: float = 0.5, progress: OnProgress = None,
               deadline: float | None = None) -> Plan:
        """Plan the threading through one cut-out, anywhere and in any direction in 3-D.

        At each depth the DLO passes the center P_goal along the normal n_goal (paper, section
        5.2). One rotation of the gripper is free (a round straight DLO may roll): the first
        waypoint turns as little as it can against `start`, each other one against the one before
        (about the mean of the gripper's axis and the normal it does not turn at all).

        Args:
            cutout: CutOut
            start: Pose of the gripper before, for its roll; None: as upright as it can be
            initial: Shape of the DLO before, its far end free, from which it has to get into the
                first shape of the plan; a permanent set that it has counts; None: it is set down
                there in its natural shape
            depths: (n,) arc lengths that have gone through, m, not decreasing, in [0, L]; None:
                40 of them from 0 to 0.95 L
            method: 'coupled' solves equilibrium and alignment as one Newton system; 'nested' is
                the paper's minimization of c arccos(t . n)^2 around the direct simulation
            gripper_clearance: m, how far the gripper's origin has to stay before the sheet: where
                no depths are given, the plan ends there
            as_deep_as_possible: where not all depths can be reached, the plan ends with the
                deepest one found, and `Plan.fraction` is its part of the last one
            linear_speed: m/s, angular_speed: rad/s: limits for the plan's times
            progress: called as progress(done, total) after each waypoint
            deadline: s of computing after which DeadlineExceeded is raised; None: no limit

        Returns:
            Plan

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: a waypoint has no stable solution, or the gripper comes too near; carries
                the plan up to it
        """
        instance('cutout', cutout, CutOut)
        instance('start', start, Pose, optional=True)
        if gripper_clearance is not None:
            gripper_clearance = number('gripper_clearance', gripper_clearance, minimum=0)
        brief = self._brief(linear_speed, angular_speed, progress, deadline)
        choice('method', method, ('coupled', 'nested'))
        simulator = self._left_by(initial)

        def planned(wanted):
            return thread(simulator, cutout, wanted, start, initial, method, brief)

        wanted = self._checked(depths)
        plan = (deepest(planned, wanted)
                if flag('as_deep_as_possible', as_deep_as_possible) else planned(wanted))
        if gripper_clearance is None:
            return plan
        kept = trim_to_clearance(plan, cutout, gripper_clearance, depths is None)
        return kept if len(kept) == len(plan) else kept_between(kept, brief)

    def insert(self, bore: CutOut, *, start: Pose | None = None, depths: ArrayLike | None = None,
               linear_speed: float = 0.1, angular_speed: float = 0.5,
               progress: OnProgress = None, deadline: float | None = None) -> Plan:
        """Plan the insertion into a bore of about the DLO's diameter (paper, section 5.2).

        The walls carry what is inside; what is outside transmits neither force nor moment to the
        mouth. Where the DLO is naturally bent, the bore still has to keep the part inside straight:
        `Plan.bore_moment`. Where a point mass or the tip's mass comes to the mouth, the plan stays
        at that depth for some waypoints, in which the mouth takes over its weight. A uniform DLO's
        gripper travels along the curve of its first shape (Zheng et al. 1991).

        Args:
            bore: CutOut: its center is that of the mouth, its normal points inwards
            start, linear_speed, angular_speed, progress, deadline: as for `thread`
            depths: as for `thread`, less than the length

        Returns:
            Plan; it may have more waypoints than `depths`. Its shapes are of what is outside, held
            at the mouth, and so is their stability; `Shape.far_wrench` is what the mouth exerts on
            that part: nothing, but where it takes over a mass

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: a waypoint has no stable solution, or the gripper would have to leap to it;
                carries the plan up to it
        """
        instance('bore', bore, CutOut)
        instance('start', start, Pose, optional=True)
        depths = self._checked(depths)
        if depths[-1] > _INSERTED * self.simulator.rod.length:
            raise InvalidTask(f'depths[{len(depths) - 1}] = {depths[-1]:g}: expected at most '
                              f'{_INSERTED:g} of the length')
        if self.simulator.surroundings.point_loads:
            raise InvalidTask('simulator.point_loads: expected none where a DLO is inserted, parts '
                              'of it are in the bore')
        return insert(self._without_obstacles, bore, depths, start,
                      self._brief(linear_speed, angular_speed, progress, deadline))

    start_phase = renamed('start_phase', 'approach')

    def approach(self, cutout: CutOut, plan: Plan, start: Pose, *, standoff: float = 0.05,
                    initial: Shape | None = None, linear_speed: float = 0.1,
                    angular_speed: float = 0.5, progress: OnProgress = None,
                    deadline: float | None = None) -> Plan:
        """Plan the way from the gripper's present pose to where a threading begins.

        The gripper backs off along the normal, turns where the DLO cannot reach the sheet, and
        comes straight to where the free end is `standoff` before the hole, aligned, and then in it.

        Args:
            cutout: CutOut; plan: the Plan of its threading
            start: Pose of the gripper now, the DLO behind the sheet
            standoff: m
            initial: Shape of the DLO now, as for `thread`; None: the one it falls into from its
                natural shape
            linear_speed, angular_speed, progress, deadline: as for `thread`

        Returns:
            Plan; its `clearance` is the distance of the DLO from the sheet's plane, its last pose
            is the first of `plan`

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: the DLO is beyond the sheet at the start, has no stable shape on the way, or
                does not come into the shape in which the plan begins
        """
        instance('cutout', cutout, CutOut)
        if not len(instance('plan', plan, Plan)):
            raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
        farthest = _FARTHEST * self.simulator.rod.length
        for name, pose in (('start', instance('start', start, Pose)),
                           ('plan.grippers[0]', plan.grippers[0])):
            away = np.linalg.norm(pose.position - cutout.center)
            if away > farthest:
                raise InvalidTask(f'{name} = {pose!r}: expected at most {farthest:g} m from the '
                                  f'cut-out, is {away:.3g} m')
        return approach(self._left_by(initial), cutout, start, plan.shapes[0],
                           number('standoff', standoff, minimum=0, maximum=farthest), initial,
                           self._brief(linear_speed, angular_speed, progress, deadline))

    def thread_two(self, first: CutOut, second: CutOut, *, start: Pose | None = None,
                   depths: ArrayLike | None = None, linear_speed: float = 0.1,
                   angular_speed: float = 0.5, progress: OnProgress = None,
                   deadline: float | None = None) -> Plan:
        """Plan the threading through two cut-outs, whose centers count (paper, section 5.2).

        From where the free end reaches the second center, both are hit at once; before, the first
        one is passed along the direction that it then has, so the way is continuous.

        Args:
            first, second: CutOut, in the order in which they are passed
            start, depths, linear_speed, angular_speed, progress, deadline: as for `thread`; depths
                count from the first cut-out

        Returns:
            Plan; `miss` is the larger of both distances, `misalignment` is 0

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: a waypoint has no stable solution; carries the plan up to it
        """
        for name, cutout in (('first', first), ('second', second)):
            instance(name, cutout, CutOut)
        instance('start', start, Pose, optional=True)
        return thread_two(self._without_obstacles, first, second, self._checked(depths), start,
                          self._brief(linear_speed, angular_speed, progress, deadline))

    def thread_sequence(self, cutouts: Iterable[CutOut], *, weights: ArrayLike | None = None,
                        start: Pose | None = None, depths: ArrayLike | None = None,
                        linear_speed: float = 0.1, angular_speed: float = 0.5,
                        progress: OnProgress = None, deadline: float | None = None) -> Plan:
        """Plan the threading through any number of cut-outs, as well as can be.

        One is passed along its normal, as by `thread`, and two at once, as by `thread_two`. More
        cannot be hit exactly: the sum of the squared weighted distances is made least, a cut-out
        counting more and more as the free end comes near.

        Args:
            cutouts: CutOuts in the order in which they are passed
            weights: (k,) of their distances; None: all alike
            start, depths, linear_speed, angular_speed, progress, deadline: as for `thread`; depths
                count from the first cut-out

        Returns:
            Plan; `Plan.position_errors` says by how much each is missed

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: a waypoint has no stable solution; carries the plan up to it
        """
        cutouts = items('cutouts', cutouts, CutOut, least=1)
        weights = np.ones(len(cutouts)) if weights is None else row('weights', weights, above=0)
        if weights.size != len(cutouts):
            raise InvalidTask(f'weights has {weights.size} entries: expected one per cut-out, '
                              f'{len(cutouts)}')
        instance('start', start, Pose, optional=True)
        depths = self._checked(depths)
        brief = self._brief(linear_speed, angular_speed, progress, deadline)
        if len(cutouts) == 1:
            return thread(self._without_obstacles, cutouts[0], depths, start, None, 'coupled',
                          brief)
        if len(cutouts) == 2:
            return thread_two(self._without_obstacles, *cutouts, depths, start, brief)
        return thread_sequence(self._without_obstacles, cutouts, weights, depths, start, brief)

    minimise_penalty = renamed('minimise_penalty', 'minimize_penalty')

    def minimize_penalty(self, penalties: object, start: Pose, *, initial: Shape | None = None,
                         max_iterations: int = 200, progress: OnProgress = None,
                         deadline: float | None = None) -> PenaltyResult:
        """Return what `minimize_penalty` finds for this simulator (paper, section 5.1).

        Its arguments are explained there.

        Raises:
            InvalidTask, NotConverged: as there
            Infeasible: what it finds breaks a demand
        """
        found = minimize_penalty(self.simulator, penalties, start, initial=initial,
                                 max_iterations=max_iterations, progress=progress,
                                 deadline=deadline)
        PlanBuilder([0.0], self._brief(1.0, 1.0, touching=True)).add(Waypoint(found.shape))
        return found

    def hold_contact(self, contact: Pose, s: float, *, condition: str | None = 'least_energy',
                     forces: ArrayLike | None = None, start: Pose | None = None,
                     linear_speed: float = 0.1, angular_speed: float = 0.5,
                     progress: OnProgress = None, deadline: float | None = None) -> Plan:
        """Plan how to hold the DLO in contact with an obstacle (paper, section 5.3, Fig. 16).

        Arc length, place and direction at the contact leave the force of contact free: a family of
        gripper poses, found without a search. Its admissible parts are intervals of the force: the
        shape is stable, with the contact as a constraint, by 0.02 at least, it is in no obstacle,
        and it keeps this simulator's demands. What is chosen from them is the least to 0.1 % and
        confirmed by the direct simulation. What hangs beyond the contact is the shape that it
        falls into from its natural one.

        Args:
            contact: Pose on the surface of one of the simulator's obstacles: x axis = direction of
                the DLO, z axis = outward normal. A DLO that is not round lies there with the axes
                (t, n, b) of its material frame along the contact's: a strip whose width is
                along n lies flat.
            s: arc length of the contact, m
            condition: which one of the family: 'least_energy' (bending), 'least_force' (a
                thousandth of weight + EI / L^2, where that can be held and the simulator's
                discretization tells it from none), 'least_motion' (from `start`),
                'largest_clearance' (from the other obstacles; without any, the least energy);
                None: a motion through the interval that has the least energy, in order of the
                force, its steps below 0.12 (rad plus parts of the length)
            forces: (n,) N: only these are looked at, as they are; None: all
            start: Pose of the gripper before
            linear_speed, angular_speed, progress, deadline: as for `thread`

        Returns:
            Plan

        Raises:
            InvalidTask: an argument makes no sense, or the contact is not on a surface
            Infeasible: no force will do; the constraint is the demand that the best one breaks, or
                'contact': by so much, in m, the DLO would be in an obstacle, or off the best of
                these shapes
        """
        s = number('s', s, above=0, below=self.simulator.rod.length)
        forces = self._contact(contact, forces, condition, start)
        if condition == 'least_motion' and start is None:
            raise InvalidTask('start = None: expected a Pose with condition \'least_motion\'')
        return hold_contact(self.simulator, contact, s, forces, condition, start,
                            self._brief(linear_speed, angular_speed, progress, deadline,
                                        touching=True))

    def slide_contact(self, contact: Pose, lengths: ArrayLike, *, condition: str = 'least_motion',
                      forces: ArrayLike | None = None, start: Pose | None = None,
                      way: str = 'aligned', linear_speed: float = 0.1, angular_speed: float = 0.5,
                      progress: OnProgress = None, deadline: float | None = None) -> Plan:
        """Plan how to draw the DLO over an obstacle, its direction there kept (Fig. 15), or not.

        Args:
            lengths: (n,) arc lengths between gripper and contact, m, one after the other
            contact, condition, forces, start: as for `hold_contact`; 'least_motion' is from one
                waypoint to the next, the first one has the least energy if there is no `start`.
                The others choose the first waypoint; each further one is the local minimum of the
                same that is nearest to the one before.
            way: 'aligned': the DLO keeps its place and direction at the contact; 'straight': the
                gripper keeps its orientation and goes straight from the first waypoint towards the
                contact, or away from it (footnote 19 of the paper). The DLO then touches where and
                as it comes to lie: `Plan.misalignment` is by how much its direction has drifted,
                `Plan.position_error` how far the place. `condition` and `forces` choose the first
                waypoint.
            linear_speed, angular_speed, progress, deadline: as for `thread`

        Returns:
            Plan

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: as for `hold_contact`; or 'continuity': no admissible shapes lead from one
                waypoint to the next, the amount is the gripper's leap (rad plus parts of the
                length); on a straight way how far the DLO falls, in m, or 'contact': how far the
                arc length that touches is from the one asked for, in m; carries the plan up to it
        """
        lengths = row('lengths', lengths, most=_MOST, above=0, below=self.simulator.rod.length)
        choice('condition', condition, CONDITIONS)
        slide = {'aligned': slide_contact, 'straight': slide_straight}[
            choice('way', way, ('aligned', 'straight'))]
        forces = self._contact(contact, forces, condition, start)
        return slide(self.simulator, contact, lengths, forces, condition, start,
                     self._brief(linear_speed, angular_speed, progress, deadline, touching=True))

    def check(self, plan: Plan, *, progress: OnProgress = None,
              deadline: float | None = None) -> Plan:
        """Return a Plan if it keeps all demands between its waypoints too.

        The path of its `Trajectory` is looked at, all of it: the gripper in the workspace and, if
        the plan does not mean to touch anything, the DLO beside the sheets around the cut-outs and
        the obstacles. Every plan made here was; one that was joined or shortened has another path.

        Args:
            plan: Plan
            progress, deadline: as for `thread`

        Raises:
            InvalidTask: an argument makes no sense; the message names it
            Infeasible: it does not; the waypoint is the one to which the gripper is going
        """
        touching = any(shape.contacts for shape in instance('plan', plan, Plan).shapes)
        return kept_between(plan, self._brief(1.0, 1.0, progress, deadline, touching))

    def _contact(self, contact, forces, condition, start):
        """Return the forces to look at or None (all); judge what both contact tasks take."""
        instance('contact', contact, Pose)
        if not self.simulator.obstacles:
            raise InvalidTask('simulator has no obstacles: expected the one to touch among them')
        instance('start', start, Pose, optional=True)
        if condition is not None:
            choice('condition', condition, CONDITIONS)
        if forces is None:
            return None
        return row('forces', forces, most=_MOST, above=0)

    def _left_by(self, initial):
        """Return the simulator of the DLO as the Shape `initial` (or None) leaves it, elastic."""
        if initial is None:
            return self._without_obstacles
        instance('initial', initial, Shape)
        self._without_obstacles._check(initial.gripper, initial)
        if initial.far_end is not None:
            raise InvalidTask('initial is held at its far end: expected a Shape whose far end is '
                              'free, as it is in the plan')
        past = initial._history
        if past is None or not past.set.any():
            return self._without_obstacles
        return self._given.with_set(initial).elastic().without_obstacles()

    def _checked(self, depths):
        length = self.simulator.rod.length
        if depths is None:
            return np.linspace(0, _DEEPEST * length, _WAYPOINTS)
        depths = row('depths', depths, most=_MOST, minimum=0, maximum=length)
        if (np.diff(depths) < 0).any():
            bad = int(np.argmax(np.diff(depths) < 0)) + 1
            raise InvalidTask(
                f'depths[{bad}] = {depths[bad]}: expected not less than the one before')
        return depths

    def _brief(self, linear_speed, angular_speed, progress=None, deadline=None, touching=False):
        speeds = (number('linear_speed', linear_speed, above=0,
                         maximum=_FASTEST * self.simulator.rod.length),
                  number('angular_speed', angular_speed, above=0, maximum=_FASTEST))
        return PlanRequirements(speeds, Progress(progress, deadline), self.workspace,
                     () if touching else self.simulator.obstacles, Surface.of(self.simulator.rod),
                     self._yield_limits, None if touching else self._without_obstacles)
