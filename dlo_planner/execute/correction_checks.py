# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What speaks against doing as an estimate of the DLO says, in words, and what miss is expected.

In a closed loop, whose motions are corrected, and in open loop, where one can only stop.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dlo_planner.execute.execution import Execution
from dlo_planner.identify.correction import Correction, correct
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.estimator import DloEstimator, EstimatorConfig
from dlo_planner.identify.online_trajectory import NARROWEST, CorrectedTrajectory
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.plan.checks import Margin, violated
from dlo_planner.plan.plan import Plan
from dlo_planner.trajectory.trajectory import Trajectory

_ANSWER = 2.0  # a DLO moves by less than so many times a jerk of its gripper
_ERRORS = 5.0  # Points may be off by so many standard deviations on the mean.
_MORE = 0.2    # So much larger than expected may the fraction of outliers be.
_SOME = 0.95   # of them
_COMPUTING = 0.3  # s; a correction is computed in this time.
_STOPPING = 3.0  # s; a motion can come to rest before the entry until so long before it.
_ANY_WINDOWS = np.full(3, NARROWEST)  # s, where nothing is blended in
_WAYPOINTS = 5   # The miss is predicted of so many, evenly from the entry to the depth.


def disagreement(observing: DloEstimator) -> str:
    """Return in words that the last looks do not agree with the estimate."""
    return ('looks at the DLO do not agree with what was expected of it (normalized innovation '
            f'{observing.normalized_innovation:.3g}, at most 1 by chance): it slips, swings or '
            'touches something, or the robot is elsewhere than it says; call ~/reset, let it hang '
            'at rest before the camera, call ~/identify, and plan again')


def misfit_reason(observing: DloEstimator, speed: float = 0.0) -> str:
    """Return in words why an Estimate is not of the DLO that is seen, '' if it may be.

    It tells of a DLO that hangs freely; one that touches something, or is held elsewhere, is none.
    """
    # a point is off across the DLO, along two axes
    seeing, estimate = observing.seeing, observing.estimate
    size = np.sqrt(2 * (seeing.noise**2 + seeing.bias**2) + seeing.sway**2)
    most = _ERRORS * float(size) + seeing.stamps * speed
    if not observing.off <= most:
        return (f'the points are {observing.off:.3g} m off the DLO as it is estimated: expected '
                f'at most {most:.3g} m, by observe.noise = {seeing.noise:g} m')
    few = min(seeing.outliers + _MORE, _SOME)
    if estimate.outliers > few:
        return (f'{estimate.outliers:.0%} of the points are none of the DLO as it is estimated: '
                f'expected at most {few:.0%}, by observe.outliers = {seeing.outliers:g}')
    return ''


def rejection_reason(correction: Correction, largest: float) -> str:
    """Return in words why a Correction must not be executed, '' if it may; see `correct`."""
    moved = float(np.linalg.norm(correction.offsets[:, 3:], axis=1).max(initial=0.0))
    broken = violated((
        Margin('equilibrium', 0.0 if correction.converged else -np.inf,
               'a waypoint has no stable shape for the DLO as it is estimated'),
        Margin('largest_correction', largest - moved, 'it moves the gripper by {found:.3g} m: '
               'expected observe.largest_correction = {limit:g} m at most', moved, largest)))
    if broken is not None:
        return broken.message
    return correction.violation or ''


def obstacles_around(inverse: InverseSimulator) -> tuple[Obstacle, ...]:
    """Return what the DLO has to stay clear of, in the workspace and beside it.

    Not the sheet that it is led through: there the bound of the miss is judged.
    """
    kept = () if inverse.workspace is None else inverse.workspace.keep_out
    return (*kept, *(body for body in inverse.simulator.obstacles
                     if not isinstance(body, Sheet) and body not in kept))


def expected_miss(estimate: Estimate, plan: Plan, execution: Execution) -> tuple[float, float]:
    """Return by how much the DLO may miss in a motion that is not corrected, and when it enters.

    m, with 95 %, as far as the estimate tells and with what motion adds; s until the entry.
    """
    way = execution.way
    if not isinstance(way, CorrectedTrajectory):
        way = CorrectedTrajectory(way, _ANY_WINDOWS)
    reached = way.reached(plan.times)
    entry = next((float(time) for time, passes in zip(reached, plan.via_points, strict=True)
                  if passes), -np.inf)
    return (miss_bound(estimate, plan, way, reached, execution.free, np.inf)
            + motion_bound(execution), entry - execution.done)


def stop_before_entry(miss: float, room: float, left: float) -> str:
    """Return in words why a motion has to stop before the cut-out, '' if it may go on.

    It goes in if the DLO is inside the cut-out with 95 %. Whether it is, is judged when the stop
    has to begin; after the entry it would be of no use.
    """
    margin = Margin('miss', room - miss, 'the DLO may miss the cut-out by {found:.3g} m (95 %): '
                    'expected at most the room of {limit:.3g} m; let it hang at rest before the '
                    'camera, call ~/identify, and plan again', miss, room)
    return margin.message if 0 < left <= _STOPPING and violated([margin]) else ''


def motion_bound(execution: Execution) -> float:
    """Return by how much motion displaces the DLO of an Execution in a cut-out at most, m.

    By what was simulated for the proof, and by what late commands did. A DLO that is displaced by a
    jerk of its gripper swings by less than twice the jerk (by its slowest vibration 1.57 times).
    """
    way = execution.way
    if isinstance(way, CorrectedTrajectory):
        way = way.trajectory
    simulated = way.motion if isinstance(way, Trajectory) else None
    bound = 0.0 if simulated is None else float(np.nan_to_num(simulated.bound, posinf=np.inf))
    return bound + _ANSWER * execution.stall_displacement


def looked_at(plan: Plan) -> Ints:
    """Return the indices of some waypoints that pass a center, whose miss is predicted.

    It is of a DLO that hangs freely: where it comes into a bore, or touches something, it is known.
    """
    passing = np.flatnonzero([bool(passes) and not shape.holds and not shape.contacts
                              for passes, shape in zip(plan.via_points, plan.shapes, strict=True)])
    some = np.linspace(0, passing.size - 1, min(_WAYPOINTS, passing.size)).astype(int)
    chosen: Ints = passing[np.unique(some)]
    return chosen


def miss_bound(estimate: Estimate, plan: Plan, way: CorrectedTrajectory, reached: Floats,
               now: float, lag: float) -> float:
    """Return within how many m the DLO passes the center with 95 %, in what is commanded.

    That lags what is aimed at: a look at the gripper in a pose serves the DLO `lag` s later and
    half the time in which a correction is blended in, by which what changes evenly is late. It may
    be blended in only after the entry.

    Shapes: reached (n,).
    """
    chosen = looked_at(plan)
    if not chosen.size:
        return 0.0
    seen = way.poses(np.maximum(reached[chosen] - lag - 0.5 * way.windows.sum(), now))
    grippers = list(plan.grippers)
    for k, pose in zip(chosen, way.poses(reached[chosen]), strict=True):
        grippers[k] = pose
    return estimate.miss(replace(plan, grippers=tuple(grippers)), chosen, seen).together


class Aimed(NamedTuple):
    """A Correction, and the 95 % bound of the miss at rest with it and with what is executed."""

    correction: Correction
    doubts: str          # why it must not be executed, '' if it may
    bound: float         # m
    bound_before: float  # m


def retargeted(inverse: InverseSimulator, estimate: Estimate, plan: Plan, way: CorrectedTrajectory,
               free: float, reached: Floats, before: Correction | None, largest: float,
               lag: float, against: str = '',
               behind: Callable[[Estimate, Correction], str] | None = None) -> Aimed:
    """Return the rest of a motion, Aimed anew for an estimate: in the closed loop and without it.

    `behind` says in words what speaks against a Correction beside what is estimated.

    Shapes: reached (n,).
    """
    first = int(np.searchsorted(reached, free))
    known = before if before is not None and before.converged else None
    found = correct(estimate, plan, first, known, inverse=inverse)
    doubts = against or rejection_reason(found, largest)
    if not doubts and behind is not None:
        doubts = behind(estimate, found)
    return Aimed(found, doubts, *(
        miss_bound(estimate, plan, one, reached, free, lag)
        for one in (way.corrected(free, found, reached[first:]), way)))


def lag_of(seeing: EstimatorConfig, horizon: float) -> float:
    """Return the seconds from a look until a motion is changed by it; inf: it is not corrected."""
    if not seeing.correct:
        return np.inf
    return seeing.period + seeing.correction_period + _COMPUTING + horizon
