# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Guards: no ratio to the floor may be much larger than the one that is kept."""

import json
from dataclasses import dataclass
from pathlib import Path

KEPT = Path(__file__).parent / 'ratios.json'
ALLOWED = 1.3


@dataclass(frozen=True)
class Excess:
    """A ratio that has grown too much."""

    name: str
    before: float
    now: float

    def __str__(self):
        return (f'{self.name}: {self.now:.2f} times the floor, {self.now / self.before - 1:+.0%} '
                f'against {self.before:.2f}')


def excesses(before: dict[str, float], now: dict[str, float], allowed: float = ALLOWED
             ) -> list[Excess]:
    """Return what has grown by more than `allowed`; what is missing on either side is passed over.

    Raises:
        ValueError: no name is on both sides: nothing was compared
    """
    common = [name for name in now if name in before]
    if not common:
        raise ValueError('nothing to compare: expected rows that are in both tables')
    return [Excess(name, before[name], now[name]) for name in common
            if now[name] > allowed * before[name]]


def load(path: Path = KEPT) -> dict[str, float]:
    """Return row -> ratio to the floor that is kept; none where there is no file."""
    return json.loads(path.read_text()) if path.exists() else {}


def store(ratios: dict[str, float], path: Path = KEPT) -> None:
    """Keep ratios for later runs."""
    path.write_text(json.dumps({name: round(value, 3) for name, value in ratios.items()},
                               indent=1) + '\n')
