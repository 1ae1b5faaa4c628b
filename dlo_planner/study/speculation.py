# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Dependent computation (paper, section 4.3.5): steps that need the one before, computed ahead.

While one task computes step i, the others compute what steps i + 1, i + 2, ... would be if the DLO
went there at once from where it is known to be: positions and velocities (or, where it is moved
slowly, the permanent set) are those of step i - 1, the time is 2 dt, 3 dt, ... When the time of
such a step comes, its search begins at the guess. Nothing else is taken from it: the
answer is the minimum of the same potential as in serial computation.

All tasks end together: a look ahead may take as much work as the step before did. So the answer
does not depend on how fast workers are.

A guess is used only where its potential is lower than where the serial search begins. What is
found from it is kept only if it has converged and Newton's method goes to it from there
(`leads_to`); otherwise the serial search is made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.boundary_motion import poses
from dlo_planner.direct.continuation import LONGEST_TURN, surely_follows
from dlo_planner.direct.equilibrium import equilibrium, past_of
from dlo_planner.direct.integrator import Scheme
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.search import TOLERANCE
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, made_by, motion_by
from dlo_planner.direct.stepper import NO_GUESS, Acceptance, StepBatch, Stepper, TimePoint
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.newton import newton
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, number
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.parallel.pool import Pool, Workers, checked
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.study.minimizers import approximate

_MOST_TASKS = 1024
_TOLERANCE, _STEPS = 1e-11, 30  # residual and Newton steps of a way that is gone to its end
_CLOSE = 1e-9  # of the unknowns: what two searches for one minimum may leave between them
_UNLIMITED = 1_000_000  # more work than anything takes
_NO_MATTER = ('obstacles', 'pinned', 'has_moments')  # of Surroundings: without them only


def speculative(simulator: DirectSimulator, grippers: Iterable[Pose], dt: float | None = None,
                executor: Workers = None, *, tasks: int | None = None,
                initial: Shape | Motion | None = None,
                velocity: ArrayLike | Callable[[float], ArrayLike] | None = None,
                tolerance: float | None = None, integrator: str = 'generalized_alpha',
                progress: OnProgress = None, deadline: float | None = None) -> Motion | list[Shape]:
    """Return a Motion, or the shapes of a slow one; each step begins with a guess computed ahead.

    The result is that of `simulator.simulate(grippers, dt, ...)`, or of `simulator.track(grippers)`
    where `dt` is None, but for what the minimizer leaves open (residuals below its tolerance); it
    does not depend on the executor or its workers. The module says when a guess is used.

    Nothing is computed ahead among obstacles, with a pinned gripper or with dead moments, nor in a
    slow motion with `accuracy` or `strains='paper'`.

    Parameters
    ----------
    simulator : DirectSimulator
    grippers : iterable of Pose
        The n poses: at the times 0, dt, 2 dt, ..., or those of a slow motion.
    dt : float, optional
        Time step in s. If None, the motion is slow (a DLO that yields depends on its steps all the
        same).
    executor : Workers, optional
        As for `parallel.map`. If None, nothing is computed ahead.
    tasks : int, optional
        Number of steps at once. One of them is the caller's own and needs no worker; the others are
        computed ahead. If None, the number that pays: 1, so none.
    initial, velocity, tolerance, integrator, progress, deadline : optional
        As for `simulate`; velocity, tolerance and integrator are ignored where `dt` is None.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    DeadlineExceeded
        The deadline is over.
    concurrent.futures.BrokenExecutor
        The executor broke for good.
    """
    instance('simulator', simulator, DirectSimulator)
    checked(executor)
    tasks = 1 if tasks is None else integer('tasks', tasks, minimum=1, maximum=_MOST_TASKS)
    steps, grippers = Progress(progress, deadline), poses(grippers)
    instance('initial', initial, (Shape, Motion), optional=True)
    at_first = initial if isinstance(initial, Shape) else None
    if dt is None and at_first is not initial:
        raise InvalidTask(f'initial = {initial!r}: expected a Shape where dt is None')
    if dt is not None:
        dt = number('dt', dt, above=0)
    alone = any(getattr(simulator.surroundings, name) for name in _NO_MATTER)
    if executor is None or tasks == 1 or alone:
        if dt is None:
            return simulator.track(grippers, progress, at_first, deadline=deadline)
        return simulator.simulate(grippers, dt, initial, velocity=velocity, tolerance=tolerance,
                                  integrator=integrator, progress=progress, deadline=deadline)
    with Pool(executor, steps.check) as pool:
        rounds = Rounds(pool, tasks)
        if dt is None:
            return track_ahead(simulator, rounds, grippers, at_first, steps)
        make = partial(AheadStepper, rounds, len(grippers) - 1)
        return motion_by(make, simulator, grippers, dt, steps, initial, None, velocity, tolerance,
                         integrator)


def _work(shape: Shape) -> int:
    """Return the work that a Shape took, as `study.minimizers.approximate` counts it."""
    return shape.evaluations or shape.iterations


class AheadStepper(Stepper):
    """Makes the steps of one DLO in moving grips, up to `last`, and computes later ones ahead."""

    nearby = False  # guesses are not near

    def __init__(self, rounds: Rounds, last: int, *more: Any) -> None:
        super().__init__(*more)
        self._rounds, self._last = rounds, last

    def steps(self, now: TimePoint, past: Any, places: Floats, scheme: Scheme, limits: Acceptance,
              guess: Floats = NO_GUESS) -> StepBatch:
        """Return the StepBatch of the first step, which may begin where it was seen ahead."""
        place, size = float(places[0]), scheme.dt / self.dt
        usual, make = self.guess(now, scheme.dt), super().steps

        def system(place: float, scheme: Scheme) -> Problem:
            return self.problem(now, place, scheme)

        def ahead(k: int) -> tuple[Problem, float] | None:
            if place + k * size > self._last:
                return None
            several = scheme._replace(dt=(k + 1) * scheme.dt)
            return system(place + k * size, several), TOLERANCE + self.rounding(several)

        def step(guess: Floats | None) -> tuple[StepBatch, Shape, bool]:
            batch = make(now, past, places[:1], scheme, limits, usual if guess is None else guess)
            shape = (batch.last if batch.refused is None else batch.refused).shape
            return batch, shape, shape.converged

        result: StepBatch = self._rounds.step(
            [place + k * size for k in range(self._rounds.tasks)], lambda: system(place, scheme),
            usual, ahead, step, self.method)
        return result


def track_ahead(simulator: DirectSimulator, rounds: Rounds, grippers: tuple[Pose, ...],
                initial: Shape | None, steps: Progress) -> list[Shape]:
    """Return the same as `DirectSimulator.track`, with later steps computed ahead."""
    shapes, before = [], initial
    plain = simulator.accuracy is None and simulator.strains == 'components'
    for place, gripper in enumerate(grippers):
        if before is not None and plain and made_by(simulator, before) and (
                not before.holds and before.parts is None):
            shape = _track_step(simulator, rounds, grippers, place, before, steps)
        else:
            shape, = simulator.track([gripper], initial=before, deadline=steps.left())
        shapes.append(shape)
        if shape.converged or shape.nearly:
            before = shape
        steps.done(len(shapes), len(grippers))
    return shapes


def _track_step(simulator: DirectSimulator, rounds: Rounds, grippers: tuple[Pose, ...],
                place: int, before: Shape, steps: Progress) -> Shape:
    mesh, gripper = simulator.mesh, grippers[place]
    history = past_of(mesh, before, simulator.history)

    def ahead(k: int) -> tuple[Problem, float] | None:
        if place + k >= len(grippers):
            return None
        return mesh.system(np.array(grippers[place + k].rotation), memory=history), TOLERANCE

    def step(guess: Floats | None) -> tuple[Shape, Shape, bool]:
        if guess is None:
            shape, = simulator.track([gripper], initial=before, deadline=steps.left())
            return shape, shape, True
        shape = equilibrium(mesh, gripper, guess, history, method=simulator.method)
        return shape, shape, surely_follows(before, shape)

    turn = angle_between(before.gripper.rotation, gripper.rotation)
    result: Shape = rounds.step(
        range(place, place + rounds.tasks),
        lambda: mesh.system(gripper.rotation, memory=history),
        mesh.strains_from(before.s, before.element_strains), ahead, step, simulator.method,
        turn <= LONGEST_TURN, lean=False)
    return result


class Round(NamedTuple):
    """A true step, and the looks ahead meanwhile."""

    place: float
    work: int               # in the unit of `study.minimizers.approximate`
    judging: int            # Newton steps beside it
    guess: str              # 'used', 'refused', or 'none'
    ahead: tuple[int, ...]  # works of the looks ahead


class Rounds:
    """Steps made while later ones are computed ahead, `tasks` at once, and the guesses of these."""

    def __init__(self, pool: Pool, tasks: int) -> None:
        self._pool, self.tasks = pool, tasks
        self._guesses: dict[float, Floats] = {}  # strains (N, 3) by place
        self._most = _UNLIMITED   # work of a look ahead
        self.made: list[Round] = []

    def step(self, places: Any, system: Callable[[], Problem], usual: Floats,
             ahead: Callable[[int], tuple[Problem, float] | None],
             step: Callable[[Floats | None], tuple[Any, Shape, bool]], method: str,
             guessed: bool = True, lean: bool = True) -> Any:
        """Return the result of the step at places[0], while those at the others are computed ahead.

        `system` is the Problem of the step, `usual` where the serial search begins, `ahead` what is
        looked at, with its tolerance, `step` what makes the step from a guess, or from `usual`, and
        says of which Shape and whether it may be used. Only where one may `lean` the way to it may
        lead over an unstable shape: else the serial step is cut into smaller ones there.
        """
        looks, strains = {}, usual
        for k in range(1, self.tasks):
            if (later := ahead(k)) is None:
                break
            strains = self._guesses.get(places[k], strains)
            looks[places[k]] = later[0], unknowns(later[0], strains), method, later[1], self._most
        futures = self._pool.submit(_look, looks.values())
        try:
            result, done = self._true_step(places[0], system, usual, step, guessed, lean)
            found = self._pool.gathered(futures)
        finally:
            for future in futures:
                future.cancel()
        self._guesses = {place: look[0] for place, look in zip(looks, found, strict=False)
                         if look is not None}
        self._most = max(done.work, 1)
        self.made.append(done._replace(ahead=tuple(0 if one is None else one[1] for one in found)))
        return result

    def _true_step(self, place: float, make: Callable[[], Problem], usual: Floats,
                   step: Callable[[Floats | None], tuple[Any, Shape, bool]], guessed: bool,
                   lean: bool) -> tuple[Any, Round]:
        failed = judging = 0
        guess = self._guesses.get(place)
        if guess is not None and guessed:
            system = make()
            start = unknowns(system, usual)
            if lower(system, unknowns(system, guess), start):
                result, shape, good = step(guess)
                failed = _work(shape)
                same, judging, leant = leads_to(system, start,
                                                unknowns(system, shape.element_strains))
                if good and same and (lean or not leant):
                    return result, Round(place, failed, judging, 'used', ())
        result, shape, _ = step(None)
        return result, Round(place, failed + _work(shape), judging,
                             'none' if guess is None else 'refused', ())


def _look(task: tuple[Problem, Floats, str, float, int]) -> tuple[Floats, int]:
    """Return strains (N, 3) of a step to come, roughly, and the work that it took; for workers."""
    system, q, method, tolerance, most = task
    return approximate(system, q, method, tolerance, most)


def unknowns(system: Problem, strains: Floats) -> Floats:
    """Return the unknowns (m, 3) of strains (N, 3)."""
    q = np.empty((system.basis.shape[2] or system.lengths.size, 3))
    unknowns_of(system, np.array(strains), q)
    return q


def lower(system: Problem, one: Floats, other: Floats) -> bool:
    """Whether the potential is lower at unknowns `one` (m, 3) than at `other`."""
    state: Configuration = new_configuration(system)
    values: list[float] = []
    for q in (one, other):
        state.q[:] = q
        values.append(evaluate(system, state)[0])
    return values[0] < values[1]


def leads_to(system: Problem, start: Floats, end: Floats) -> tuple[bool, int, bool]:
    """Return whether Newton's method goes from `start` to `end` (m, 3), its steps, and if it leant.

    It has to go all the way. One step and the Hessian there do not tell: that of what yields jumps,
    and beyond an unstable shape minima lie close together.
    """
    minimum = newton(system, start, _TOLERANCE, _STEPS, False)
    away = np.linalg.norm(minimum.state.q - end)
    arrived = minimum.residual < _TOLERANCE and away <= _CLOSE * np.linalg.norm(end)
    return bool(arrived), minimum.iterations, bool(minimum.kicks)
