# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By how much a DLO that several grips hold is not where a plan has it.

Each grip is off by an error of its own, with the deviations that an Uncertainty has for the
gripper; the DLO is off as stated there. A miss is how far the place of the DLO goes that goes
farthest: by less than the clearance it touches nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Holds, posed
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import Progress
from dlo_planner.uncertainty.parameters import CAUSES
from dlo_planner.uncertainty.state import UncertainState, stretched

_OF_GRIPS = 'gripper_rotation', 'gripper_position'  # causes
_PLACES = 33  # of the DLO, at which misses to first order are looked at

Work: TypeAlias = tuple[UncertainState, Sequence[Shape], Floats]


def errors_drawn(uncertain: UncertainState, rng: np.random.Generator, samples: int,
                 grips: int) -> Floats:
    """Return (samples, 1 + grips, n) states: of the DLO and gripper, then of each other grip.

    Of the latter only what is of a gripper counts.
    """
    return rng.normal(size=(samples, 1 + grips, uncertain.size)) * uncertain.deviations


def first_order(uncertain: UncertainState, plan: Plan, progress: Progress) -> Floats:
    """Return (n, causes) root mean square misses, to first order."""
    out = np.zeros((len(plan), len(CAUSES)))
    deviations = {name: getattr(uncertain.uncertainty, name)
                  for name in ('gripper_rotation', 'gripper_position')}
    for k, shape in enumerate(plan.shapes):
        progress.check()
        places = np.linspace(0, shape.s[-1], _PLACES)
        sensitivity = Sensitivity(shape)
        slopes = np.array([sensitivity.by_grips(float(s))[3:] for s in places])
        # by the rotation, then by the displacement of each grip; the same about any axes
        twists = slopes.reshape(_PLACES, 3, -1, 2, 3)
        for part, (name, deviation) in enumerate(deviations.items()):
            squares = (twists[:, :, :, part]**2).sum(axis=(1, 2, 3)) * deviation**2
            out[k, CAUSES.index(name)] = np.sqrt(squares.max())
        for name in dict.fromkeys(uncertain.causes):
            if name not in deviations:
                out[k, CAUSES.index(name)] = _by_rod(uncertain, shape, name)
    return out


def _by_rod(uncertain: UncertainState, shape: Shape, name: str) -> float:
    """Return the root mean square miss by one cause of the DLO itself, by differences."""
    squares, s = np.zeros(_PLACES), np.linspace(0, 1, _PLACES)
    for index, (cause, deviation) in enumerate(zip(uncertain.causes, uncertain.deviations,
                                                   strict=True)):
        if cause != name:
            continue
        ends = []
        for sign in (-1, 1):
            z = np.zeros(uncertain.size)
            z[index] = sign * deviation
            rod = uncertain.rod(z)
            drawn = uncertain.simulator.with_rod(rod)
            found = drawn.solve(shape.gripper, stretched(shape, rod.length), holds=shape.holds)
            if not found.converged:
                return np.inf
            ends.append(found.positions_at(s * rod.length))
        squares += (((ends[1] - ends[0]) / 2)**2).sum(axis=1)
    return float(np.sqrt(squares.max()))


def plug_deviations(uncertain: UncertainState, plan: Plan, gravity: Floats,
                    progress: Progress) -> Floats:
    """Return (n, 6) standard deviations of `Plan.plug_wrenches`, to first order; nan: no plug.

    By differences of solves, one deviation to either side of each grip and property; the errors are
    those of `first_order`. They are about the front where it is thought to be.
    """
    out = np.full((len(plan), 6), np.nan)
    for k, shape in enumerate(plan.shapes if plan.plug is not None else ()):
        progress.check()
        squares = np.zeros(6)
        for index, (cause, deviation) in enumerate(zip(uncertain.causes, uncertain.deviations,
                                                       strict=True)):
            if cause in _OF_GRIPS:
                # each number of the state is one axis of each grip
                axis = int(uncertain.columns(cause)[0].tolist().index(index))
                twist = np.zeros(6)
                twist[axis + (0 if cause == _OF_GRIPS[0] else 3)] = deviation
                ends = [[_plug_wrench(plan, shape, gravity, uncertain, grip, sign * twist)
                         for sign in (-1, 1)] for grip in range(1 + len(shape.holds))]
            else:
                z = np.zeros(uncertain.size)
                z[index] = deviation
                ends = [[_plug_wrench(plan, shape, gravity, uncertain, 0, np.zeros(6), sign * z)
                         for sign in (-1, 1)]]
            squares += sum((0.5 * (after - before))**2 for before, after in ends)
        out[k] = np.sqrt(squares)
    return out


def _plug_wrench(plan: Plan, shape: Shape, gravity: Floats, uncertain: UncertainState, grip: int,
                 twist: Floats, z: Floats | None = None) -> Floats:
    """Return (6,) what the hand has to give if a grip is off by a twist, and the DLO by z.

    Infinite where there is no such shape.
    """
    assert plan.plug is not None
    rod = uncertain.simulator.rod if z is None else uncertain.rod(z)
    gripper = displaced(shape.gripper, twist) if grip == 0 else shape.gripper
    holds = tuple(posed(hold, displaced(hold.pose, twist)) if grip == k else hold
                  for k, hold in enumerate(shape.holds, start=1))
    simulator = uncertain.simulator if z is None else uncertain.simulator.with_rod(rod)
    found = simulator.solve(gripper, stretched(shape, rod.length), holds=holds)
    if not found.converged:
        return np.full(6, np.inf)
    wrench = plan.plug.wrench(gripper, found.gripper_wrench, gravity)
    shift = plan.plug.front(gripper).position - plan.plug.front(shape.gripper).position
    wrench[3:] += np.cross(shift, wrench[:3])
    return wrench


def sampled(work: Work) -> Floats:
    """Return (m, n) misses of the samples (m, 1 + A, k), each followed through the plan."""
    uncertain, shapes, draws = work
    out = np.empty((len(draws), len(shapes)))
    for i, (z, *of_grips) in enumerate(draws):
        drawn = uncertain.simulator
        if uncertain.parameters.size:
            drawn = drawn.with_rod(uncertain.rod(z))
        offsets = [uncertain.offset(one) for one in (z, *of_grips)]
        initial: Shape | None = None
        for k, shape in enumerate(shapes):
            start = stretched(shape, drawn.rod.length) if initial is None else initial
            gripper, holds = _off(shape, offsets)
            reached = drawn.track([gripper], initial=start, holds=holds)[0]
            initial = reached if reached.converged else initial
            out[i, k] = apart(reached, shape) if reached.converged else np.inf
    return out


def _off(shape: Shape, offsets: Sequence[Pose]) -> tuple[Pose, Holds]:
    """Return the gripper and the Holds of a Shape, each off by its own Pose."""
    own, *others = offsets
    holds = tuple(posed(hold, hold.pose.compose(offset))
                  for hold, offset in zip(shape.holds, others, strict=True))
    return shape.gripper.compose(own), holds
