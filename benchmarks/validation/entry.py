# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a validation is: something that is run again, and numbers with limits read from it."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

NUMBER = r'([-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?)'


@dataclass(frozen=True)
class Measure:
    """A number in what a script prints.

    Attributes:
        what: of what it is
        read: returns it from the text; raises ValueError if the text does not have it
        limit: what it has to stay below, or above if `least`
    """

    what: str
    read: Callable[[str], float]
    limit: float
    unit: str = ''
    least: bool = False

    def judged(self, text: str) -> dict[str, object]:
        """Return what was measured as JSON can hold it."""
        value = self.read(text)
        met = value >= self.limit if self.least else value <= self.limit
        return {'what': self.what, 'measured': value, 'limit': self.limit, 'unit': self.unit,
                'least': self.least, 'met': bool(met and math.isfinite(value))}


@dataclass(frozen=True)
class Validation:
    """A script of the repository whose numbers the documentation states.

    Attributes:
        shows: what it shows
        against: what it is compared with
        script: path from the root of the repository, or '-m module'
        arguments: those of `make validation`: a sample where the whole takes too long
        whole: those of the whole, for a larger run by hand; empty: the same
        extra: a package that it needs
        data: an environment variable that names a folder with data that it needs
    """

    name: str
    shows: str
    against: str
    script: str
    arguments: tuple[str, ...]
    measures: tuple[Measure, ...]
    whole: tuple[str, ...] = ()
    extra: str = ''
    data: str = ''


def largest(pattern: str) -> Callable[[str], float]:
    """Return what reads the largest of all numbers where {} stands in a pattern."""
    return _of_all(pattern, max)


def smallest(pattern: str) -> Callable[[str], float]:
    """Return what reads the smallest of all numbers where {} stands in a pattern."""
    return _of_all(pattern, min)


def others_than(*good: str) -> Callable[[str], float]:
    """Return what counts outcomes of another kind in the last line of '12 kind, 3 other kind'."""
    def read(text: str) -> float:
        line = _counts(text)
        return float(sum(int(number) for number, kind in line if kind.split(',')[0] not in good))
    return read


def _of_all(pattern: str, choose: Callable[[list[float]], float]) -> Callable[[str], float]:
    looked_for = re.compile(pattern.replace('{}', NUMBER), re.MULTILINE)

    def read(text: str) -> float:
        found = [float(group) for match in looked_for.finditer(text) for group in match.groups()]
        if not found:
            raise ValueError(f'nothing like {pattern!r} was printed')
        return choose(found)
    return read


def _counts(text: str) -> list[tuple[str, str]]:
    one = r'\d+ [^\d\n,][^\d\n]*'  # '3 refused, stability' is one kind
    lines = re.findall(rf'^{one}(?:, {one})*$', text, re.MULTILINE)
    if not lines:
        raise ValueError('no line with numbers of outcomes was printed')
    return re.findall(r'(\d+) (.+?)(?=, \d|$)', lines[-1])
