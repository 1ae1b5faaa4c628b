# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By how much a DLO that several grips hold is not where a plan has it.

Each grip is off by an error of its own, with the deviations that an Uncertainty has for the
gripper; the DLO is off as stated there. A miss is how far the place of the DLO goes that goes
farthest: by less than the clearance it touches nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.sliding import answers_at
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


class Mouth(NamedTuple):
    """The mouth of a fitting, which is off as each grip is."""

    along: Floats  # (3,) unit vectors: the DLO's tangent in it,
    aside: Floats  # and across that and the way in
    s: float       # the place of the DLO that passes it, m


def first_order(uncertain: UncertainState, plan: Plan, progress: Progress,
                mouths: Sequence[Mouth | None] | None = None) -> Floats:
    """Return (n, causes) root mean square misses, to first order.

    Those of a DLO in a Mouth are aside of it.
    """
    out = np.zeros((len(plan), len(CAUSES)))
    for k, (shape, mouth) in enumerate(zip(plan.shapes, mouths or [None] * len(plan),
                                           strict=True)):
        progress.check()
        length = float(shape.s[-1])
        places = np.linspace(0, 1, _PLACES) if mouth is None else np.array([mouth.s / length])
        across = np.eye(3)
        if mouth is not None:  # another place passes it then, level with it
            tangent = shape.frame_at(mouth.s)[0][:, 0]
            across = (mouth.aside - (mouth.aside @ tangent) / (mouth.along @ tangent)
                      * mouth.along)[None]
        # by the rotation, then by the displacement of each grip; the same about any axes
        twists = (across @ answers_at(shape, (places * length).tolist())[:, 3:]).reshape(
            len(places), len(across), -1, 2, 3)
        for part, name in enumerate(_OF_GRIPS):
            squares = (twists[:, :, :, part]**2).sum(axis=(1, 2, 3)).max() + (
                mouth is not None and name == _OF_GRIPS[1])
            out[k, CAUSES.index(name)] = np.sqrt(squares) * getattr(uncertain.uncertainty, name)
        for name in dict.fromkeys(uncertain.causes):
            if name not in _OF_GRIPS:
                out[k, CAUSES.index(name)] = _by_rod(uncertain, shape, name, places, across)
    return out


def _by_rod(uncertain: UncertainState, shape: Shape, name: str, s: Floats,
            across: Floats) -> float:
    """Return the root mean square miss by one cause of the DLO itself, by differences.

    At places s of the length, in the directions `across` (k, 3).
    """
    squares = np.zeros(s.size)
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
        squares += (((ends[1] - ends[0]) @ across.T / 2)**2).sum(axis=1)
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
            gripper, holds = off(shape, offsets)
            reached = drawn.track([gripper], initial=start, holds=holds)[0]
            initial = reached if reached.converged else initial
            out[i, k] = apart(reached, shape) if reached.converged else np.inf
    return out


def off(shape: Shape, offsets: Sequence[Pose]) -> tuple[Pose, Holds]:
    """Return the gripper and the Holds of a Shape, each off by its own Pose."""
    own, *others = offsets
    holds = tuple(posed(hold, hold.pose.compose(offset))
                  for hold, offset in zip(shape.holds, others, strict=True))
    return shape.gripper.compose(own), holds
