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
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.boundary_motion import poses
from dlo_planner.direct.continuation import LONGEST_TURN, surely_follows
from dlo_planner.direct.integrator import KinematicState, Scheme
from dlo_planner.direct.memory import Memory
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, Prescribed, made_by, motion_by
from dlo_planner.direct.statics import TOLERANCE, equilibrium
from dlo_planner.direct.step import past_of
from dlo_planner.direct.stepper import Limits, StepBatch, StepMemory, Stepper, TimePoint
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.classic import approximate
from dlo_planner.minimize.newton import newton
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, number
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.parallel.pieces import Shared
from dlo_planner.parallel.workers import Crew, Workers, checked
from dlo_planner.progress import OnProgress, Progress

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
    at_first = _first_shape(initial, dt)
    if dt is not None:
        dt = number('dt', dt, above=0)
    alone = any(getattr(simulator.surroundings, name) for name in _NO_MATTER)
    if executor is None or tasks == 1 or alone:
        if dt is None:
            return simulator.track(grippers, progress, at_first, deadline=deadline)
        return simulator.simulate(grippers, dt, initial, velocity=velocity, tolerance=tolerance,
                                  integrator=integrator, progress=progress, deadline=deadline)
    with Crew(executor, steps.check) as crew:
        rounds = Rounds(crew, tasks)
        if dt is None:
            return Tracker(simulator, rounds).track(grippers, at_first, steps)
        make = partial(AheadStepper, rounds, len(grippers) - 1)
        return motion_by(make, simulator, Prescribed(grippers, dt, initial, None, velocity,
                                                     tolerance, integrator), steps)


def _first_shape(initial: Shape | Motion | None, dt: float | None) -> Shape | None:
    """Return `initial` if it is a Shape, else None; raise InvalidTask if it makes no sense."""
    instance('initial', initial, (Shape, Motion), optional=True)
    if dt is None and isinstance(initial, Motion):
        raise InvalidTask(f'initial = {initial!r}: expected a Shape where dt is None')
    return initial if isinstance(initial, Shape) else None


def _work(shape: Shape) -> int:
    """Return the work that a Shape took, as `minimize.classic.approximate` counts it."""
    return shape.evaluations or shape.iterations


class AheadStepper(Stepper):
    """Makes the steps of one DLO in moving grips, and computes later ones ahead.

    Parameters
    ----------
    rounds : Rounds
    last : int
        Place of the last step.
    more : object
        As for Stepper.
    """

    nearby = False  # guesses are not near

    def __init__(self, rounds: Rounds, last: int, *more: Any) -> None:
        super().__init__(*more)
        self._rounds, self._last, self._shared = rounds, last, Shared(Stepper(*more))

    def steps(self, now: TimePoint, past: Any, places: Floats, scheme: Scheme,
              limits: Limits) -> StepBatch:
        """Return the StepBatch of the first step, which may begin where it was seen ahead."""
        place, usual = float(places[0]), self.guess(now, scheme.dt)

        def ahead(most: int) -> dict[float, Task]:
            return self._ahead(now, place, scheme, usual, most)

        def begun(guess: Floats) -> tuple[StepBatch, Shape]:
            batch = self.steps_from(now, past, places[:1], scheme, limits, guess)
            return batch, (batch.last if batch.refused is None else batch.refused).shape

        def step(guess: Floats | None) -> Stepped:
            vain = judging = 0
            if guess is not None:
                system, budget = self._system(now, place, scheme), limits.budget.copy()
                start = _unknowns(system, usual)
                if lower(system, _unknowns(system, guess), start):
                    batch, shape = begun(guess)
                    vain = _work(shape)
                    same, judging, _ = leads_to(system, start,
                                                _unknowns(system, shape.element_strains))
                    if shape.converged and same:
                        return Stepped(batch, vain, judging, 'used')
                    limits.budget[:] = budget
            batch, shape = begun(usual)
            return Stepped(batch, vain + _work(shape), judging,
                           'none' if guess is None else 'refused')

        result: StepBatch = self._rounds.make(place, ahead, step)
        return result

    def _ahead(self, now: TimePoint, place: float, scheme: Scheme, usual: Floats,
               most: int) -> dict[float, Task]:
        """Return Moving tasks by place."""
        size, strains = scheme.dt / self.dt, usual
        tasks: dict[float, Task] = {}
        for k in range(1, self._rounds.tasks):
            later = place + k * size
            if later > self._last:
                break
            guess = self._rounds.guess(later)
            strains = strains if guess is None else guess  # else those of the place before
            tasks[later] = Moving(self._shared, now.nodes, now.bends, now.memory, later,
                                  replace(scheme, dt=(k + 1) * scheme.dt), strains, most)
        return tasks

    def _system(self, now: TimePoint, place: float, scheme: Scheme) -> Problem:
        return self.problem(now.nodes, now.bends, now.memory, place, scheme)


def _unknowns(system: Any, strains: Floats) -> Floats:
    q = np.empty((system.basis.shape[1] or system.lengths.size, 3))
    unknowns_of(system, np.array(strains), q)
    return q


class Tracker:
    """Follows a DLO through slow steps, and computes later ones ahead.

    Parameters
    ----------
    simulator : DirectSimulator
    rounds : Rounds
    """

    def __init__(self, simulator: DirectSimulator, rounds: Rounds) -> None:
        self._simulator, self._rounds, self._shared = simulator, rounds, Shared(simulator)

    def track(self, grippers: tuple[Pose, ...], initial: Shape | None,
              steps: Progress) -> list[Shape]:
        """Return the same as `DirectSimulator.track`."""
        shapes, before = [], initial
        for place, gripper in enumerate(grippers):
            if before is None or not self._can(before):
                shape, = self._simulator.track([gripper], initial=before, deadline=steps.left())
            else:
                shape = self._step(grippers, place, before, steps)
            shapes.append(shape)
            if shape.converged or shape.nearly:
                before = shape
            steps.done(len(shapes), len(grippers))
        return shapes

    def _can(self, before: Shape) -> bool:
        """Whether steps after the Shape `before` can be computed ahead."""
        simulator = self._simulator
        return (simulator.accuracy is None and simulator.strains == 'components'
                and made_by(simulator, before) and before.far_end is None and before.parts is None)

    def _step(self, grippers: tuple[Pose, ...], place: int, before: Shape,
              steps: Progress) -> Shape:
        mesh, gripper = self._simulator.mesh, grippers[place]
        history = past_of(mesh, before, self._simulator.history)
        usual = mesh.strains_from(before.s, before.element_strains)

        def ahead(most: int) -> dict[float, Task]:
            tasks: dict[float, Task] = {}
            strains = usual
            for later in range(place + 1, min(place + self._rounds.tasks, len(grippers))):
                guess = self._rounds.guess(later)
                strains = strains if guess is None else guess
                tasks[later] = Resting(self._shared, np.array(grippers[later].rotation),
                                       replace(history, of=None), strains, most)
            return tasks

        def step(guess: Floats | None) -> Stepped:
            vain = judging = 0
            turn = angle_between(before.gripper.rotation, gripper.rotation)
            if guess is not None and turn <= LONGEST_TURN:
                system = mesh.system(gripper.rotation, memory=history)
                start = _unknowns(system, usual)
                if lower(system, _unknowns(system, guess), start):
                    shape, kicks = equilibrium(mesh, gripper, guess, self._simulator.method,
                                               history)
                    end, vain = _unknowns(system, shape.element_strains), _work(shape)
                    same, judging, leant = leads_to(system, start, end)
                    # an unstable shape on the way: the serial step is cut into smaller ones
                    if same and not leant and surely_follows(before, shape, kicks):
                        return Stepped(shape, vain, judging, 'used')
            shape, = self._simulator.track([gripper], initial=before, deadline=steps.left())
            return Stepped(shape, vain + _work(shape), judging,
                           'none' if guess is None else 'refused')

        result: Shape = self._rounds.make(place, ahead, step)
        return result


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


# What workers do: shapes of steps to come, roughly, from a shape that is known.


class Moving(NamedTuple):
    """A DLO in motion, several steps in one.

    Attributes
    ----------
    stepper : Shared
        Shared Stepper.
    nodes, bends : KinematicState
        Those of now.
    memory : StepMemory
        What is left to the next step.
    place : float
        Where to look, in instants.
    scheme : Scheme
        Scheme of one step from now to there.
    strains : ndarray, shape (N, 3)
        Strains in 1/m, where the search begins.
    most : int
        Work, in the unit of `minimize.classic.approximate`.
    """

    stepper: Shared
    nodes: KinematicState
    bends: KinematicState
    memory: StepMemory
    place: float
    scheme: Scheme
    strains: Floats
    most: int


class Resting(NamedTuple):
    """A DLO that is moved slowly, several steps in one.

    Attributes
    ----------
    simulator : Shared
        Shared DirectSimulator.
    rotation : ndarray, shape (3, 3)
        Rotation of the gripper there.
    history : Memory
        Memory of now.
    strains : ndarray
        As for Moving.
    most : int
        As for Moving.
    """

    simulator: Shared
    rotation: Floats
    history: Memory
    strains: Floats
    most: int


class Guess(NamedTuple):
    """What was seen: strains (N, 3) in 1/m, and the work that it took."""

    strains: Floats
    work: int


def look(task: Moving | Resting) -> Guess:
    """Return the Guess that a task asks for."""
    if isinstance(task, Moving):
        stepper = task.stepper.content
        method = stepper.method
        system = stepper.problem(task.nodes, task.bends, task.memory, task.place, task.scheme)
        rounding = stepper.rounding(task.scheme)
    else:
        simulator = task.simulator.content
        method, rounding = simulator.method, 0.0
        system = simulator.mesh.system(task.rotation, memory=task.history)
    q = np.empty((system.basis.shape[1] or system.lengths.size, 3))
    unknowns_of(system, np.array(task.strains), q)
    return Guess(*approximate(system, q, method, TOLERANCE + rounding, task.most))


Task = Moving | Resting  # of a look ahead


class Round(NamedTuple):
    """A true step, and the looks ahead meanwhile.

    Attributes
    ----------
    place : float
        Place of the step.
    work : int
        Work of it, in the unit of `minimize.classic.approximate`.
    judging : int
        Newton steps beside it.
    guess : str
        'used', 'refused', or 'none'.
    ahead : tuple of int
        Works of the looks ahead.
    """

    place: float
    work: int
    judging: int
    guess: str
    ahead: tuple[int, ...]


class Stepped(NamedTuple):
    """What a true step gave.

    Attributes
    ----------
    result : object
        Result of the step.
    work, judging : int
        As in Round.
    guess : str
        As in Round.
    """

    result: Any
    work: int
    judging: int
    guess: str


class Rounds:
    """Steps made while later ones are computed ahead, and the guesses of these.

    Parameters
    ----------
    crew : Crew
    tasks : int
        Steps at once, the true one among them.

    Attributes
    ----------
    made : list of Round
        One Round for each round.
    """

    def __init__(self, crew: Crew, tasks: int) -> None:
        self._crew, self.tasks = crew, tasks
        self._guesses: dict[float, Floats] = {}  # place: strains
        self._most = _UNLIMITED   # work of a look ahead
        self.made: list[Round] = []

    def guess(self, place: float) -> Floats | None:
        """Return the strains (N, 3) that were computed ahead for a place, or None."""
        return self._guesses.get(place)

    def make(self, place: float, ahead: Callable[[int], dict[float, Task]],
             step: Callable[[Floats | None], Stepped]) -> Any:
        """Return the result of a step at `place`, while later ones are computed ahead."""
        tasks = ahead(self._most)
        futures = self._crew.begin(look, tasks.values())
        try:
            stepped = step(self.guess(place))
            guesses = self._crew.gathered(futures)
        finally:
            for future in futures:
                future.cancel()
        self._guesses = {later: guess.strains for later, guess in zip(tasks, guesses, strict=False)
                         if guess is not None}
        done = Round(place, stepped.work, stepped.judging, stepped.guess,
                     tuple(0 if one is None else one.work for one in guesses))
        self._most = max(done.work, 1)
        self.made.append(done)
        return stepped.result
