# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through one cut-out: at every depth the DLO passes the center along the normal.

The gripper rolls as its route says, or only where the DLO would hardly be stable. Such rolls come
in jerks, each a corner of its path: afterwards the same plan is tried with even ones. The sum of
the rolls is how far it has to be rolled at each depth; a smooth curve along it (Whittaker 1923) is
about the same path without corners.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.advice import advice
from dlo_planner.inverse.continuation import (
    DOUBTFUL,
    Aligned,
    BranchPoint,
    Follower,
    RollSchedule,
    SolutionBranch,
    continue_branch,
)
from dlo_planner.inverse.equilibria import (
    Candidate,
    Crossings,
    HangingShapes,
    hanging_shapes,
    is_axisymmetric,
    shape_with_end,
    start_candidates,
)
from dlo_planner.inverse.held_inside import HeldInside
from dlo_planner.inverse.most_room import best_rating, missed_between, thread_with_most_room
from dlo_planner.inverse.reachable import reachable_shapes
from dlo_planner.inverse.route import (
    NO_WAY,
    Threading,
    find_route,
    gets_there,
    grid_nodes,
    plan_branch,
    quick_simulator,
    sweep,
    with_certificate,
)
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, flag, instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder, kept_between
from dlo_planner.plan.checks import ROOM
from dlo_planner.plan.margin import upright_room
from dlo_planner.plan.plan import Plan, PlanStatus, least_rating, truncate
from dlo_planner.plan.waypoint import Waypoint

_FIRM = (1e3, 1e2, 1e1, 1.0)  # how much smoothness counts: features of 35 to 6 waypoints go
_NO_ROLL = 1e-3     # rad between two waypoints
_AS_STABLE = 0.8    # of what counts as doubtful, or of what there is: rolled evenly it may be less
_FEW = 60           # waypoints at most of a plan that is only a trial
_CURVES = 32        # depths at which a route is looked for
_STARTS = 80, 24    # shapes looked at: set down in the natural shape, brought from an initial one
_AHEAD = 0.0, 0.15  # of the length: other smoothings of a route
_PREFERENCE = 0.01  # for a start without a turn, per rad^2, against rad^2 of motion on the way
_LOOKED_AT = 4      # waypoints of a plan along the normal that tell whether it has room enough:
_ENOUGH = 0.5       # of the room of an upright DLO, as margin
_GAIN = 0.1         # of that room, or of a `rating`: an oblique plan has to leave so much more
_HALVINGS = 6       # of the depth between the last waypoint that is reached and the next one


@dataclass(frozen=True, eq=False)
class EvenRolls:
    """How far the gripper has rolled about the free axis at n depths: a route."""

    depths: Floats  # (n,) m
    turned: Floats  # (n,) rad

    def roll(self, branch: SolutionBranch, point: BranchPoint, depth: float,
             target: float) -> float:
        """Return the roll (rad) to make between two depths, m."""
        del branch, point
        return float(np.diff(np.interp((depth, target), self.depths, self.turned))[0])


def even_rolls(branch: SolutionBranch, depths: Floats,
               points: Sequence[BranchPoint]) -> Iterator[EvenRolls]:
    """Yield EvenRolls, ever less smooth, along the rolls between n BranchPoints at n depths."""
    rolls = [Rotation.from_matrix(after.shape.gripper.rotation @ before.shape.gripper.rotation.T)
             .as_rotvec() @ branch.axis(before.shape)
             for before, after in zip(points, points[1:], strict=False)]
    if len(rolls) < 2 or np.abs(rolls).max() < _NO_ROLL:
        return
    turned = np.append(0.0, np.cumsum(rolls))
    bends = np.diff(np.eye(turned.size), 2, axis=0)
    for firm in _FIRM:
        yield EvenRolls(depths, np.linalg.solve(np.eye(turned.size) + firm * bends.T @ bends,
                                                turned))


def thread_from(simulator: DirectSimulator, task: Threading, begin: Candidate,
                route: RollSchedule | None = None) -> Plan:
    """Return the Plan that continues a Candidate through all depths."""
    cutout, length = task.cutouts[0], simulator.rod.length
    aligned = Aligned(simulator, cutout.normal, cutout.center, task.method)
    holes = task.holes(length)
    guess, reference, depth = begin

    def waypoint(point: BranchPoint) -> Waypoint:
        return holes.passed(point.waypoint(cutout.center, length - point.depth,
                                             cutout.normal))

    builder = PlanBuilder(task.depths, task.demands, initial=task.initial)
    points, rolled = continue_branch(
        builder, Follower(aligned, aligned.from_guess(guess, depth, reference), depth, task.depths,
                          route), waypoint,
        may_roll=not is_axisymmetric(simulator.rod) and not isinstance(route, EvenRolls))
    plan = builder.finished()
    if not rolled:
        return plan
    silent = replace(task, demands=task.demands.silent())
    for even in even_rolls(aligned, task.depths, points):
        try:
            smooth = thread_from(simulator, silent, begin, even)
        except Infeasible:
            continue
        if smooth.stability.min() >= _AS_STABLE * min(DOUBTFUL, plan.stability.min()):
            return smooth
    return plan


def first_choice(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading that begins with its first Candidate, without a route."""
    return thread_from(simulator, task, next(start_candidates(
        simulator, task.cutouts[0].normal, task.start)))


def thread(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading; see `InverseSimulator.thread`.

    Which roll of the DLO the threading begins with is free, and how it rolls on the way. The plan
    that begins with the first candidate and rolls only where it has to is tried first. If it is
    refused, the sphere of all hanging shapes shows a better route, or that there is none. The
    search uses a quick simulator, whatever the accuracy of the plan.
    """
    task = replace(task, demands=task.demands.made_with(simulator))
    quick = quick_simulator(simulator)
    own = quick is simulator
    trial = task if own else task.tried_with(quick)
    candidates = start_candidates(quick, task.cutouts[0].normal, task.start)
    first: tuple[Candidate, RollSchedule | None] = next(candidates), None

    def planned(task: Threading, way: tuple[Candidate, RollSchedule | None]) -> Plan:
        return thread_from(quick, task, *way)

    plan, way = plan_branch(trial, planned, first, partial(_other_ways, quick, trial, candidates),
                            _FEW)
    if own:
        return plan
    if way is first:  # on its own mesh
        return first_choice(simulator, task)
    return thread_from(simulator, task, *way)


def _other_ways(simulator: DirectSimulator, task: Threading, candidates: Iterator[Candidate],
                refused: Infeasible | None) -> Iterator[tuple[Candidate, RollSchedule | None]]:
    """Yield other Candidates, each with a Route or None, after a refusal."""
    assert refused is not None  # there is a first candidate
    if refused.constraint not in NO_WAY:  # a demand: another roll may keep it
        yield from ((begin, None) for begin in candidates)
        return
    if is_axisymmetric(simulator.rod):
        return
    shapes = hanging_shapes(simulator.surroundings, grid_nodes(simulator))
    if shapes is None:
        yield from ((begin, None) for begin in candidates)
        return
    depths, layers = _layers(simulator, shapes, task.cutouts[0].normal, task.depths)
    route = find_route(layers, depths, _starts(simulator, layers[0], task), simulator.rod.length)
    if route is not None:
        guess = shape_with_end(simulator.mesh, route.end)
        begin = Candidate(guess, guess.gripper.rotation, float(route.depths[0]))
        yield begin, route
        if route.complete:  # smoothed rolls may miss a narrow route, or jump on a rough one
            yield from ((begin, replace(route, ahead=ahead)) for ahead in _AHEAD)
    # the grid may be too coarse: where the DLO hardly stands, the stable shapes can be a strip
    # narrower than its mesh
    if route is None or route.complete:
        yield from ((begin, None) for begin in candidates)


def _layers(simulator: DirectSimulator, shapes: HangingShapes, normal: Floats,
            depths: Floats) -> tuple[Floats, list[Crossings]]:
    """Return depths (k,), as many as are looked at, and the shapes along the normal at each."""
    aligned = Aligned(simulator, normal)
    depths = np.unique(np.linspace(depths[0], depths[-1], _CURVES))
    return depths, [aligned.crossings(shapes, depth) for depth in depths]


def _starts(simulator: DirectSimulator, curve: Crossings, task: Threading) -> Floats:
    """Return the cost (m,) of beginning at each of the Crossings; infinite where it cannot.

    The DLO has to take the shape by itself. Among these shapes the cost is least where the gripper
    is turned least from `start`.
    """
    cost = np.full(len(curve), np.inf)
    most = _STARTS[task.initial is not None]
    for k in np.unique(np.linspace(0, len(curve) - 1, min(len(curve), most)).astype(int)):
        gripper = Pose.from_rotation(task.cutouts[0].center + curve.places[k], curve.grippers[k])
        if gets_there(simulator, gripper, curve.ends[k], task.initial):
            turn = 0.0 if task.start is None else angle_between(
                gripper.rotation, task.start.rotation)
            cost[k] = _PREFERENCE * turn**2
    return cost


def certificate(simulator: DirectSimulator, cutout: CutOut, depths: Floats) -> str:
    """Return in words at which depths (n,), m, quickly found stable shapes pass a cut-out."""
    quick = quick_simulator(simulator)
    shapes = hanging_shapes(quick.surroundings, grid_nodes(quick))
    if shapes is None:
        return ''
    looked_at, layers = _layers(quick, shapes, cutout.normal, depths)
    reached_by_turning = reachable_shapes(quick, 0.0, _unchecked)
    count = len(shapes.stability)
    if reached_by_turning is not None:  # of a soft DLO the grid of ends has hardly a stable shape
        _, others = _layers(quick, reached_by_turning.hanging, cutout.normal, depths)
        layers = [one.with_others(other) for one, other in zip(layers, others, strict=True)]
        count += len(reached_by_turning.shapes)
    stable = np.array([len(layer) > 0 for layer in layers])
    reached = len(sweep(layers, np.zeros(len(layers[0])), quick.rod.length)[0])
    begin = (f'of {count} shapes in which the DLO hangs, {looked_at.size} depths '
             'looked at: ')
    if not stable.any():
        return f'{begin}no stable one is along the normal at any depth'
    ends = looked_at[stable][[0, -1]]
    if not stable[0]:
        return (f'{begin}no stable one is along the normal at depth {looked_at[0]:.4g} m, where '
                f'the plan begins; some are between {ends[0]:.4g} and {ends[1]:.4g} m')
    if reached < looked_at.size:
        none = '' if stable[reached] else ', where there is none'
        return (f'{begin}stable ones are along the normal from depth {looked_at[0]:.4g} m on, but '
                f'none leads from {looked_at[reached - 1]:.4g} to {looked_at[reached]:.4g} m{none}')
    return f'{begin}stable ones are along the normal at each, in reach of each other'


def _unchecked() -> None:
    """Let a computation go on."""


def trim_to_clearance(plan: Plan, cutout: CutOut, clearance: float, may_end: bool) -> Plan:
    """Return the part of a Plan in which the gripper is `clearance` m before the sheet."""
    rooms = np.array([(cutout.center - gripper.position) @ cutout.normal
                      for gripper in plan.grippers])
    if (rooms >= clearance).all():
        return plan
    index = int(np.argmax(rooms < clearance))
    if may_end and index:
        return truncate(plan, index, PlanStatus.COMPLETE)
    raise Infeasible(f'waypoint {index} (depth {plan.depths[index]:g} m): the gripper is '
                     f'{rooms[index]:.3g} m before the sheet, gripper_clearance = {clearance:g} m',
                     index, 'gripper_clearance', float(clearance - rooms[index]),
                     truncate(plan, index, PlanStatus.PARTIAL))


def deepest(planned: Callable[[Floats], Plan], depths: Floats) -> Plan:
    """Return the Plan of the depths (n,) that can be reached, and of the deepest one found.

    Its `fraction` is the deepest depth as a part of the last requested one.
    """
    try:
        return planned(depths)
    except Infeasible as error:
        count = 0 if error.plan is None else len(error.plan)
        if not count:
            raise
    good, bad, plan = depths[:count], depths[count], None
    for _ in range(_HALVINGS):
        tried = np.append(good, 0.5 * (good[-1] + bad))
        try:
            plan, good = planned(tried), tried
        except Infeasible:
            bad = tried[-1]
    plan = planned(good) if plan is None else plan
    return replace(plan, fraction=float(good[-1] / depths[-1]))


def _with_room(along: Callable[[], Plan], oblique: Callable[[], Plan], room: float,
               best: Callable[[Floats], float], missed: Callable[[Plan], float]) -> Plan:
    """Return the Plan along the normal, or an oblique one that leaves more of the `room`, m.

    `best`: an upper bound of the least rating of any plan at depths (k,), m. `missed`: by how much
    a plan misses the center between its waypoints, m.
    """
    refused: Infeasible | None = None
    plan: Plan | None = None
    try:
        plan = along()
        some = np.unique(np.linspace(0, len(plan) - 1, _LOOKED_AT).astype(int))
        if least_rating(plan, some, room) >= min(_ENOUGH, best(plan.depths[some]) - _GAIN):
            return plan
    except Infeasible as error:
        refused = error
    try:
        other = oblique()
    except Infeasible as error:
        if plan is not None:
            return plan
        assert refused is not None  # else there is a plan
        raise _refused_both(refused, error) from None
    if plan is None:
        return other
    one, another = (least_rating(each, np.arange(len(each)), room) for each in (plan, other))
    if another < one + _GAIN or missed(other) > ROOM * other.clearances.min():
        return plan  # of few waypoints an oblique one would lose its room between them
    return other


def _refused_both(along: Infeasible, oblique: Infeasible) -> Infeasible:
    """Return the refusal of a passage along the normal that says why none is oblique either."""
    along.args = (f'{along}; obliquely: {oblique}',)
    return along


@dataclass(frozen=True, eq=False, repr=False)
class Thread(Task):
    """Thread through one cut-out; `InverseSimulator.thread` says what the attributes mean.

    Attributes
    ----------
    cutout : CutOut
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through, m. If None, chosen by the solver.
    method : str
        'coupled' or 'nested'.
    gripper_clearance : float or None
        Distance in m that the gripper keeps from the sheet. If None, any.
    as_deep_as_possible : bool
        Whether the plan may end before the last depth.
    max_misalignment : float or None
        Largest angle against the normal at which the DLO may pass, rad. With 0 it passes along
        the normal, or the task is refused. If None, any: along the normal where that leaves half
        of the room as `Plan.margin`, else obliquely if that leaves a tenth of the room more. A
        cut-out without a size is passed along its normal.
    hold_at : float or None
        Where the gripper holds the DLO, m from its beginning. If None, at its beginning.
    """

    takes_initial: ClassVar[bool] = True
    threads: ClassVar[bool] = True
    deepest: ClassVar[float | None] = 1.0
    grasps_inside: ClassVar[bool] = True
    # how obliquely it may pass stays what was asked for
    replanned: ClassVar[Mapping[str, Any]] = MappingProxyType({
        'method': 'coupled', 'gripper_clearance': None, 'as_deep_as_possible': False})

    cutout: CutOut
    depths: Floats | None = None
    method: str = 'coupled'
    gripper_clearance: float | None = None
    as_deep_as_possible: bool = False
    max_misalignment: float | None = None
    hold_at: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, cutout: CutOut, depths: ArrayLike | None = None,
                     method: str = 'coupled', gripper_clearance: float | None = None,
                     as_deep_as_possible: bool = False, max_misalignment: float | None = None,
                     hold_at: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('cutout', self.cutout, CutOut)
        if self.gripper_clearance is not None:
            put(self, gripper_clearance=number('gripper_clearance', self.gripper_clearance,
                                               minimum=0))
        if self.hold_at is not None:
            put(self, hold_at=number('hold_at', self.hold_at, minimum=0) or None)
        choice('method', self.method, ('coupled', 'nested'))
        if self.max_misalignment is not None:
            put(self, max_misalignment=number('max_misalignment', self.max_misalignment, minimum=0,
                                              maximum=np.pi / 2, unit='rad'))
        flag('as_deep_as_possible', self.as_deep_as_possible)
        put(self, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    def _threaded(self, free: DirectSimulator, task: Threading) -> Plan:
        """Return the Plan of a DLO that is held at its beginning."""
        along = partial(with_certificate, partial(thread, free, task),
                        partial(certificate, free, self.cutout, task.depths))
        room = upright_room(self.cutout, task.demands.surface)
        if self.max_misalignment == 0 or room == np.inf:
            return along()
        most = np.inf if self.max_misalignment is None else self.max_misalignment
        try:
            if room <= 0:  # no direction is better
                return along()
            return self._chosen(along, partial(thread_with_most_room, free, task, most), partial(
                _with_room, room=room, best=partial(best_rating, free, task.demands.uncertainty,
                                                    room),
                missed=partial(missed_between, free)))
        except Infeasible as error:
            error.advise = partial(advice, free, task, most)
            raise

    def _chosen(self, along: Callable[[], Plan], oblique: Callable[[], Plan],
                choose: Callable[[Callable[[], Plan], Callable[[], Plan]], Plan]) -> Plan:
        """Return the Plan along the normal or the oblique one, as `choose` does."""
        return choose(along, oblique)

    @property
    def seen(self) -> bool:
        """Whether the DLO was looked at where it starts."""
        return False

    @property
    def held_inside(self) -> float | None:
        """Where the gripper holds the DLO inside, m; None: at its beginning."""
        return self.hold_at

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        inside = None if self.hold_at is None else HeldInside(context, self.hold_at, (self.cutout,))
        front = context if inside is None else inside.front  # what is threaded
        demands = context.demands if inside is None else inside.demands
        depths = depths_on(front.rod.length, self.depths)

        def planned(depths: Floats) -> Plan:
            free, task = front.without_obstacles, Threading(
                (self.cutout,), depths, front.start, front.demands, front.initial, self.method,
                self.seen)
            solve = partial(self._threaded, free, task)
            return solve() if inside is None else inside.planned(solve)

        plan = deepest(planned, depths) if self.as_deep_as_possible else planned(depths)
        if self.gripper_clearance is None:
            return plan
        kept = trim_to_clearance(plan, self.cutout, self.gripper_clearance, self.depths is None)
        return kept if len(kept) == len(plan) else kept_between(kept, demands)


@dataclass(frozen=True, eq=False, repr=False)
class ThreadLookedAt(Thread):
    """A Thread of a DLO that was looked at where it starts.

    What looks leave unknown of how it is bent and held is hardly a miss while the gripper stands as
    it stood then, and turns with it: where it passes obliquely, the gripper rolls as little as it
    can from there on. Before the hole, it passes along the normal or obliquely as was planned when
    it was led there, whichever would leave a little more room now: it would have to be led past the
    sheet to where the other way begins. Where that is not possible any more, it passes as it can.

    Attributes
    ----------
    obliquely : bool or None
        Whether it was to pass obliquely when it was led to where it starts. None: it was not led
        there for that.
    """

    obliquely: bool | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, cutout: CutOut, depths: ArrayLike | None = None,
                     method: str = 'coupled', gripper_clearance: float | None = None,
                     as_deep_as_possible: bool = False, max_misalignment: float | None = None,
                     hold_at: float | None = None,
                     obliquely: bool | None = None) -> None: ...

    def __post_init__(self) -> None:
        if self.obliquely is not None:
            flag('obliquely', self.obliquely)
        super().__post_init__()

    @property
    def seen(self) -> bool:
        """Whether it was looked at where it starts."""
        return True

    def _chosen(self, along: Callable[[], Plan], oblique: Callable[[], Plan],
                choose: Callable[[Callable[[], Plan], Callable[[], Plan]], Plan]) -> Plan:
        """Return the Plan of the kind that it was, if there is one."""
        if self.obliquely is None:
            return choose(along, oblique)
        try:
            return oblique() if self.obliquely else along()
        except Infeasible:
            return choose(along, oblique)
