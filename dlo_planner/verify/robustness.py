# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Robustness of a plan: by how much it misses when the DLO or the robot are not as assumed.

To first order, from the sensitivities of the equilibrium, for each cause separately; and sampled,
for deviations of any size. A miss is the distance from a center to be passed of the DLO, extended
straight where it is too short. Of a DLO that several grips hold it is how far any place of it is
off (`held_robustness`), in the mouth of a fitting how far aside of its middle (`route_robustness`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from dlo_planner.direct.grasp import GraspedInside, held_as
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.held_inside import front_of
from dlo_planner.inverse.tasks.route import Fitting
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import figure, instance, integer, items, number, results
from dlo_planner.model.holds import alike
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import brief, put, same
from dlo_planner.pictured import Answer
from dlo_planner.plan.margin import miss_slopes
from dlo_planner.plan.plan import Passes, Plan, passages, rooms_in_holes
from dlo_planner.progress import OnProgress, Progress, interrupted_by
from dlo_planner.uncertainty.parameters import CAUSES, VARIATION, Uncertainty
from dlo_planner.uncertainty.state import UncertainState, stretched
from dlo_planner.verify.held_robustness import errors_drawn, first_order, plug_deviations
from dlo_planner.verify.held_robustness import sampled as held_sampled
from dlo_planner.verify.route_robustness import RouteWork, entries_of, mouths_of, rooms_of
from dlo_planner.verify.route_robustness import sampled as route_sampled

_AT_ONCE = 25   # samples in one piece of work
_LOOKS = 2      # from above each mouth

_Work: TypeAlias = tuple[UncertainState, Sequence[Shape], Sequence[Passes], Floats]


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(Answer):
    """Misses of a plan under an Uncertainty; n waypoints, m samples.

    Attributes
    ----------
    causes : tuple of str
        Names in Uncertainty.
    by_cause : ndarray
        (n, len(causes)) root mean square of the miss due to each alone, to first order, m.
    first_order : ndarray, shape (n,)
        The same due to all together.
    sampled : ndarray, shape (m, n)
        Misses of the samples, m; infinite where one has no stable shape.
    success : float
        Part of the samples that miss by less than the room, at every waypoint: the least of the
        plan's `clearances` there, of all three parts of the DLO. Misses are across the DLO, and by
        as much an oblique one may be displaced in any direction. Of a DLO that is held elsewhere,
        too, the room is the plan's `clearance`. Of a Route it is the `room` of the fitting in whose
        mouth the DLO is; else the sample touches nothing, nor a fitting ahead. nan without samples
        or without any room.
    plug_wrenches : ndarray, shape (n, 6)
        Standard deviations of `Plan.plug_wrenches`, to first order, N and N m, world axes: by how
        much what the hand feeds forward is wrong. Infinite where a deviation leaves no shape; nan
        where no plug is held.
    """

    causes: tuple[str, ...]
    by_cause: Floats
    first_order: Floats
    sampled: Floats
    success: float
    plug_wrenches: Floats = ()  # type: ignore[assignment]  # an array (n, 6) from then on

    def __post_init__(self) -> None:
        causes = items('Robustness.causes', self.causes, str, least=1)
        first_order = results('Robustness.first_order', self.first_order, (None,))
        by_cause = results('Robustness.by_cause', self.by_cause, (None, len(causes)))
        n = len(by_cause)
        if isinstance(self.plug_wrenches, tuple) and not self.plug_wrenches:
            put(self, plug_wrenches=np.full((n, 6), np.nan))
        if first_order.size != n:
            raise InvalidTask(f'Robustness.by_cause has {n} rows, Robustness.first_order '
                              f'{first_order.size} entries: expected as many')
        put(self, causes=causes, first_order=first_order, by_cause=by_cause,
            sampled=results('Robustness.sampled', self.sampled, (None, n)),
            success=figure('Robustness.success', self.success),
            plug_wrenches=results('Robustness.plug_wrenches', self.plug_wrenches, (n, 6)))
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f'{self.first_order.size} waypoints',
                     f'first order {self.first_order.max(initial=0):.2g} m',
                     f'worst {self.worst}' if self.first_order.any() else '',
                     f'{len(self.sampled)} samples' if len(self.sampled) else '',
                     '' if np.isnan(self.success) else f'success {self.success:.3g}')

    @property
    def worst(self) -> str:
        """Name of the cause with the largest miss of all waypoints."""
        return self.causes[int(np.argmax(self.by_cause.max(axis=0)))]

    def quantile(self, part: float) -> Floats:
        """Return the misses (n,) that `part` (0 to 1) of the samples do not exceed, m.

        Raises
        ------
        InvalidTask
            `part` is not between 0 and 1, or there are no samples.
        """
        part = number('part', part, minimum=0, maximum=1)
        if not len(self.sampled):
            raise InvalidTask('samples = 0: expected samples for a quantile')
        result: Floats = np.sort(self.sampled, axis=0)[int(np.ceil(part * (len(self.sampled) - 1)))]
        return result


def robustness(simulator: DirectSimulator | GraspedInside, plan: Plan, uncertainty: Uncertainty,
               *, fittings: Iterable[Fitting] = (), hand_stiffness: float | None = None,
               seen: float | None = None, samples: int = 0, seed: int = 0,
               executor: Executor | None = None, progress: OnProgress = None,
               deadline: float | None = None) -> Robustness:
    """Return the Robustness of a plan under an Uncertainty.

    Parameters
    ----------
    simulator : DirectSimulator or GraspedInside
        DirectSimulator for which the plan was made, of the whole DLO.
    plan : Plan
        Plan of a threading, which is examined without obstacles, or of a contact; or of a DLO that
        is held elsewhere, too, which is examined without obstacles. Of a DLO that is
        held inside, the part in front of the gripper is examined: what is uncertain of it, as its
        length, is in parts of that part. The part behind, which decides nothing in the cut-out, is
        not.
    uncertainty : Uncertainty
        Standard deviations of the DLO and of the gripper's pose; those of each other grip are the
        same, and independent.
    fittings : iterable of Fitting, optional
        Those of the Route that the plan is of, which close on its way: each is off as the gripper
        is, by an error of its own, and takes the place of the DLO that has come to lie in it.
    hand_stiffness : float, optional
        Of samples of a Route: how stiff the hand is that leads the DLO and is fed with
        `Plan.gripper_wrench_at`, N/m. It gives way along the DLO, to what this pulls more or less
        than planned. If None, it does not: a DLO that is drawn taut has no shape.
    seen : float, optional
        Of samples of a Route: standard deviation of what a camera tells of the DLO's place above
        each mouth where the plan stops there, aside and out of it, m. The gripper takes away what
        is seen, as `closed_loop.centered` does, in two looks. If None, nobody looks.
    samples : int, optional
        Number of samples; 0: first order only.
    seed : int, optional
        Seed of the draws.
    executor : Executor, optional
        A `concurrent.futures.Executor` for the samples, e.g. a ProcessPoolExecutor; None: one after
        the other. The result does not depend on it.
    progress : callable, optional
        Called as progress(done, total) after each batch of samples.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, there is no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    DeadlineExceeded
        The deadline is over; samples that an executor has begun go on.
    """
    fittings = items('fittings', fittings, Fitting)
    made_for, plan = _made_for(simulator, plan, bool(fittings))
    entries = entries_of(plan, fittings) if fittings else []
    instance('uncertainty', uncertainty, Uncertainty)
    stiffness = np.inf if hand_stiffness is None else number(
        'hand_stiffness', hand_stiffness, above=0, unit='N/m')
    camera = None if seen is None else number('seen', seen, minimum=0, unit='m')
    for name, value in (('hand_stiffness', stiffness), ('seen', camera)):
        if value not in (None, np.inf) and not fittings:
            raise InvalidTask(f'{name} = {value:g}: expected None without the fittings of a Route')
    samples = integer('samples', samples, minimum=0, maximum=1_000_000)
    seed = integer('seed', seed, minimum=0, maximum=2**63)
    if executor is not None:
        instance('executor', executor, Executor)
    steps = Progress(progress, deadline)
    uncertain = UncertainState(made_for, uncertainty, 1 + VARIATION)
    rng, held = np.random.default_rng(seed), plan.shapes[0].holds
    run: Any = map if executor is None else executor.map
    misses, least = [np.zeros((0, len(plan)))], [np.zeros(0)]
    with interrupted_by(steps.check):
        plug_wrenches = plug_deviations(uncertain, plan, made_for.surroundings.gravity, steps)
        if held or fittings:
            by_cause = first_order(uncertain, plan, steps, mouths_of(plan, fittings, entries))
            errors = errors_drawn(uncertain, rng, samples, len(held) + len(fittings))
            looks = (camera or 0.0) * rng.normal(size=(
                samples, len(fittings), 0 if camera is None else _LOOKS, 2))
            parts = [slice(k, k + _AT_ONCE) for k in range(0, samples, _AT_ONCE)]
            obstacles = simulator.surroundings.obstacles
            found = run(route_sampled, [RouteWork(
                uncertain, plan.shapes, fittings, entries, obstacles, stiffness, errors[part],
                looks[part]) for part in parts]) if fittings else run(
                held_sampled, [(uncertain, plan.shapes, errors[part]) for part in parts])
        else:
            by_cause = _first_order(uncertain, plan, steps)
            draws = uncertain.draw(rng, samples)
            found = run(_sampled, [(uncertain, plan.shapes, plan.via_points, draws[k:k + _AT_ONCE])
                                   for k in range(0, samples, _AT_ONCE)])
        for batch in found:
            missed, left = batch if fittings else (batch, np.full(len(batch), np.inf))
            misses.append(missed)
            least.append(left)
            steps.done(len(misses) - 1, -(-samples // _AT_ONCE))
    sampled = np.concatenate(misses)
    if fittings:
        room = rooms_of(fittings, entries)
    else:
        room = plan.clearance if held else rooms_in_holes(plan).min(axis=1, initial=np.inf)
    success = np.nan
    if samples and np.isfinite(room).any():
        success = float(((sampled < room).all(axis=1) & (np.concatenate(least) > 0)).mean())
    return Robustness(CAUSES, by_cause, np.sqrt((by_cause**2).sum(axis=1)), sampled, success,
                      plug_wrenches)


def _made_for(simulator: DirectSimulator | GraspedInside, plan: Plan,
              closes: bool) -> tuple[DirectSimulator, Plan]:
    """Return the elastic simulator of a Plan, and it; of a DLO held inside those of its front.

    Raise InvalidTask if it was made for another; `closes`: whether what holds it may change.
    """
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    held = held_as('simulator', simulator, plan.shapes[0])
    if isinstance(held, GraspedInside):
        return _made_for(held.parts[1], front_of(plan, Surface.of(held.parts[1].rod)), closes)
    if any(shape.s[-1] != held.rod.length for shape in plan.shapes):
        raise InvalidTask('plan: expected shapes of the simulator\'s whole DLO')
    own = held.history is not None  # its set makes a rod of its own
    elastic = held.elastic()
    if not own and not all(_acts_alike(shape, elastic) for shape in plan.shapes):
        raise InvalidTask('simulator: expected the one for which the plan was made, with its rod, '
                          'gravity and load')
    if not closes and any(not alike(shape.holds, plan.shapes[0].holds) for shape in plan.shapes):
        raise InvalidTask(f'plan has {len(plan.stages)} stages, in which the DLO is held '
                          'differently: expected one, or the fittings of its Route')
    if any(shape.contacts for shape in plan.shapes):
        return elastic, plan
    return elastic.without_obstacles(), plan  # a rim would hold it back, and hide the miss


def _acts_alike(shape: Shape, simulator: DirectSimulator) -> bool:
    """Whether a Shape is of a simulator's rod with its gravity and load; obstacles may differ.

    So may the parameters of yielding: nothing yields here.
    """
    mesh = shape.state.mesh
    return mesh is not None and same(*(replace(around, obstacles=(), rod=replace(
        around.rod, yield_curvature=None, yield_torsion=None, section_model='ideal', hardening=0.0))
        for around in (mesh.surroundings, simulator.surroundings)))


def _first_order(uncertain: UncertainState, plan: Plan, progress: Progress) -> Floats:
    """Return (n, causes) root mean square misses."""
    out = np.zeros((len(plan), len(CAUSES)))
    stated, causes = np.zeros(uncertain.size), [CAUSES.index(name) for name in uncertain.causes]
    for k, (shape, passes) in enumerate(zip(plan.shapes, plan.via_points, strict=True)):
        if not passes or not uncertain.size:
            continue
        progress.check()
        squares, slopes_at = np.zeros((len(passes), len(CAUSES))), uncertain.slopes(stated, shape)
        for square, goal in zip(squares, passages(passes, float(shape.s[-1])), strict=True):
            off = miss_slopes(slopes_at, goal)[1]
            np.add.at(square, causes, (off**2).sum(axis=0) * uncertain.deviations**2)
        out[k] = np.sqrt(squares[np.argmax(squares.sum(axis=1))])
    return out


def _sampled(work: _Work) -> Floats:
    """Return (m, n) largest misses of the samples z (m, k)."""
    uncertain, shapes, passes, draws = work
    out = np.empty((len(draws), len(shapes)))
    for i, z in enumerate(draws):
        drawn, offset = uncertain.simulator, uncertain.offset(z)
        if uncertain.parameters.size:
            drawn = drawn.with_rod(uncertain.rod(z))
        initial = None
        for k, shape in enumerate(shapes):
            # it starts where the plan does, and then goes its own way
            start = stretched(shape, drawn.rod.length) if initial is None else initial
            reached = drawn.track([shape.gripper.compose(offset)], initial=start)[0]
            initial = reached if reached.converged else initial
            out[i, k] = max((np.linalg.norm(goal.residuals(reached)) for goal in passages(
                passes[k], float(reached.s[-1]))), default=0.0)
            if not reached.converged:
                out[i, k] = np.inf
    return out
