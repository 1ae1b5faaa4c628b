# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rounds of a dependent computation: a true step, and looks at those to come meanwhile."""

from collections.abc import Callable
from typing import Any, NamedTuple

from dlo_planner.model.arrays import Floats
from dlo_planner.parallel.ahead import UNLIMITED, Moving, Resting, look
from dlo_planner.parallel.workers import Crew

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
        self._most = UNLIMITED   # work of a look ahead
        self.made: list[Round] = []

    def guess(self, place: float) -> Floats | None:
        """Return the strains (N, 3) that were computed ahead for a place, or None."""
        return self._guesses.get(place)

    def make(self, place: float, ahead: Callable[[int], dict[float, Task]],
             step: Callable[[Floats | None], Stepped]) -> Any:
        """Return the result of a step at `place`, while later ones are computed ahead.

        Parameters
        ----------
        ahead : callable
            Tasks by place, made as ahead(most).
        step : callable
            Called as step(strains or None); returns a Stepped.
        """
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
