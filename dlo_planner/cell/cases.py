# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What may go wrong in the cell, by name: disturbances and a camera, drawn by seeds.

In each the robot is not quite where it measures, follows late, and the sheet rubs; in most of them
something else happens.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from dlo_planner.cell.camera import BAD, GOOD, Camera
from dlo_planner.cell.disturbances import Bump, Disturbances, Slip
from dlo_planner.cell.truth import NOTHING_UNKNOWN, UNCERTAIN, VERY_UNCERTAIN
from dlo_planner.model.checks import choice, integer

# 0.5 mm and 0.1 degrees rms across its way: 0.35 mm and 1.25 mrad along and about each axis,
# another one in each pose; and the wandering one, twice as much in time
NOMINAL = Disturbances(0.35e-3, 1.25e-3, lag=0.03, friction=0.3)
_WHEN = 2.0, 20.0     # s, between which something happens: on the way, at the standoff, in the hole
_PUSHED = 0.01        # m
_BLIND = 0.3          # of the time
_SECOND = 0.2         # of the points
_REACTION = 1.0       # s before the entry: latency, two looks, coming to rest


def case(name: str, seed: int) -> tuple[Disturbances, Camera]:
    """Return the Disturbances and the Camera of a case in CASES and a seed, always the same."""
    choice('name', name, CASES)
    return CASES[name](np.random.default_rng(
        [integer('seed', seed, minimum=0, maximum=2**31), 80]))


def strikes_inside(times: Iterable[float], begin: float, end: float) -> bool:
    """Return whether one of the `times` is in the DLO's stay in the hole, or shortly before, s.

    So shortly that it is not seen, or the DLO not at rest, at the entry.
    """
    return any(begin - _REACTION <= time <= end for time in times)


def _slipped(rng: np.random.Generator, back: float, turn: float) -> Disturbances:
    """Return a slip back, with a turn about any axis."""
    when, axis = rng.uniform(*_WHEN), rng.standard_normal(3)
    return replace(NOMINAL, slips=(Slip(when, back, turn * axis / np.linalg.norm(axis)),))


def _bumped(rng: np.random.Generator) -> Disturbances:
    """Return a push of the free end or the middle in any direction."""
    bump = Bump(rng.uniform(*_WHEN), _PUSHED, rng.standard_normal(3), float(rng.choice((0.5, 1.0))))
    return replace(NOMINAL, bumps=(bump,))


CASES: dict[str, Callable[[np.random.Generator], tuple[Disturbances, Camera]]] = {
    'nominal': lambda rng: (NOMINAL, BAD),
    'slip': lambda rng: (_slipped(rng, 2e-3, np.radians(1.0)), BAD),
    'small slip': lambda rng: (_slipped(rng, 0.5e-3, np.radians(0.29)), BAD),
    'bump': lambda rng: (_bumped(rng), BAD),
    'wandering': lambda rng: (replace(NOMINAL, robot_position=0.0, robot_rotation=0.0,
                                      wander_position=0.7e-3, wander_rotation=2.5e-3), BAD),
    'hidden': lambda rng: (NOMINAL, replace(BAD, blind=_BLIND)),
    'second cable': lambda rng: (NOMINAL, replace(BAD, second_cable=_SECOND))}

# what the planner does not know, and the camera
UNKNOWNS = {'nothing': (NOTHING_UNKNOWN, GOOD), 'much': (UNCERTAIN, GOOD),
            'more': (VERY_UNCERTAIN, BAD)}
