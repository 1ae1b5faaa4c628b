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
from dlo_planner.cell.disturbances import Bump, Disturbances, Kink, Slip
from dlo_planner.cell.truth import NOTHING_UNKNOWN, UNCERTAIN, VERY_UNCERTAIN
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, integer

# 0.5 mm and 0.1 degrees rms across its way: 0.35 mm and 1.25 mrad along and about each axis,
# another one in each pose; and the wandering one, twice as much in time
NOMINAL = Disturbances(0.35e-3, 1.25e-3, lag=0.03, friction=0.3)
_WHEN = 2.0, 20.0     # s, between which something happens: on the way, at the standoff, in the hole
_PUSHED = 0.01        # m
_BLIND = 0.3          # of the time
_SECOND = 0.2         # of the points
_KINK = 0.02          # rad
_KINKED = 0.2, 0.8    # of the length, between which
_TURN = np.radians(0.5)  # of a camera's frame
_CAMERA = 0.0, 0.0, 0.8  # m from the hole: where that camera is
_OFFSET = 3e-3        # m: of a camera
_DRIFT = 1e-3 / 60, np.radians(0.1) / 60  # m/s, rad/s: of a camera whose mount warms up
_LATE = 0.1           # s
_MOVED = 4.5e-3       # m: a sheet with its hole
_REACTION = 1.0       # s before the entry: latency, two looks, coming to rest


def case(name: str, seed: int) -> tuple[Disturbances, Camera]:
    """Return the Disturbances and the Camera of a case and a seed, always the same.

    One of CASES, or one or several of FAULTS, with ' + ' between them.
    """
    key = [integer('seed', seed, minimum=0, maximum=2**31), 80]
    if name in CASES:
        return CASES[name](np.random.default_rng(key))
    rng, both = np.random.default_rng(key), (NOMINAL, BAD)
    names = instance('name', name, str).split(JOINED)
    for one in names:  # a case by itself is none that a fault can be added to
        both = FAULTS[choice('name', one, FAULTS if len(names) > 1 else [*CASES, *FAULTS])](
            rng, *both)
    return both


def _kinked(rng: np.random.Generator, course: Disturbances,
            camera: Camera) -> tuple[Disturbances, Camera]:
    """Add a push that leaves a kink."""
    bumped = _bumped(rng)
    when, place, about = bumped.bumps[0].time, rng.uniform(*_KINKED), rng.uniform(0, 2 * np.pi)
    return replace(course, bumps=bumped.bumps, kinks=(Kink(when, _KINK, place, about),)), camera


def _direction(rng: np.random.Generator, size: float) -> Floats:
    """Return a vector (3,) of a size in any direction."""
    vector = rng.standard_normal(3)
    result: Floats = size * vector / np.linalg.norm(vector)
    return result


Fault = Callable[[np.random.Generator, Disturbances, Camera], tuple[Disturbances, Camera]]
# what a loop is deceived by that believes its tracker: each changes what is there without it
FAULTS: dict[str, Fault] = {
    'kink': _kinked,
    'filled in': lambda rng, course, camera: (course, replace(
        camera, blind=_BLIND, fills_in=True, hidden=0.0, outliers=0.0)),
    'turned camera': lambda rng, course, camera: (course, replace(
        camera, turn=_direction(rng, _TURN), turned_about=np.array(_CAMERA))),
    'biased camera': lambda rng, course, camera: (course, replace(
        camera, offset=_direction(rng, _OFFSET))),
    'drifting camera': lambda rng, course, camera: (course, replace(
        camera, drift=_direction(rng, _DRIFT[0]), turn_drift=_direction(rng, _DRIFT[1]),
        turned_about=np.array(_CAMERA))),
    'late stamps': lambda rng, course, camera: (course, replace(
        camera, stamp_error=float(rng.choice((-_LATE, _LATE))))),
    'moved hole': lambda rng, course, camera: (replace(
        course, sheets_shift=_direction(rng, _MOVED)), replace(camera, sees_hole=True))}
JOINED = ' + '  # between two of their names


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
