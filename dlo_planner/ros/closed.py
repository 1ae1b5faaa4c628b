# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan is executed in a closed loop: `ThreadingLoop` in real time, its plans in a process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Lock, Thread
from typing import Any

import numpy as np

from dlo_planner.errors import DeadlineExceeded, DloPlannerError
from dlo_planner.execute.causes import Cause, Refused, cause_of
from dlo_planner.execute.execution import Execution
from dlo_planner.execute.threading_loop import Threading, ThreadingLoop
from dlo_planner.identify.closed_loop import Phase
from dlo_planner.identify.observing import Observing
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.ros.health import Health
from dlo_planner.ros.planning import Made
from dlo_planner.ros.state import Looking, State
from dlo_planner.ros.store import Store
from dlo_planner.ros.worker import Worker, persistent

_STANDOFF = 0.05  # of the length, where none is given, and the plan does not stop before the hole
_SAME = 1e-9      # m, and of unit vectors


def threading_of(made: Made) -> Threading | None:
    """Return what a plan threads, if that is one cut-out whose room is known; else None."""
    plan, scene = made.plan, made.scene
    rod, radius = scene.direct.rod, scene.cutout_radius
    if radius is None or not isinstance(rod.radius, float) or radius <= rod.radius:
        return None
    passing = np.array([bool(passes) for passes in plan.via_points])
    passes = [one for some in plan.via_points for one in some]
    if not passes or len(passes) != passing.sum():
        return None
    center, _, normal = passes[0]
    if normal is None or any(
            one[2] is None or np.abs(one[0] - center).max() > _SAME
            or np.abs(one[2] - normal).max() > _SAME for one in passes):
        return None
    depths = plan.depths[passing]
    if depths[0] > 0:  # the way to the entry ends there, where nothing passes yet
        depths = np.append(0.0, depths)
    stops = [normal @ (center - plan.shapes[k].positions[-1]) for k in plan.stops if not passing[k]]
    standoff = scene.standoff if scene.standoff > 0 else float(
        max(stops, default=0.0)) or _STANDOFF * rod.length
    return Threading(scene.inverse, CutOut(Pose.looking_along(center, normal), radius=radius),
                     depths, standoff, scene.limits)


def closed_loop_of(state: State, observing: Observing | None,
                   worker: Worker) -> ClosedLoopDrive | None:
    """Return what carries out the plan that was started in a closed loop, or None: it cannot.

    `observing` is of the DLO as stated, None where nobody looks; `worker` plans.
    """
    made, execution, scene = state.running, state.execution, state.scene
    if observing is None or not observing.seeing.correct or made is None or execution is None:
        return None
    task = threading_of(made)
    if task is None or state.heard is None:
        return None
    tool = made.scene.tool
    loop = ThreadingLoop(task, observing, state.heard.pose.compose(tool), tool=tool,
                         guards=execution.guards, limits=execution.limits,
                         period=execution.period, horizon=execution.horizon,
                         frame_id=execution.frame_id)
    return ClosedLoopDrive(loop, worker, scene.planning_deadline)


def not_looked_at(state: State, observing: Observing | None) -> str:
    """Return in words that a plan is executed without a look that it could have, '' if it is not.

    `observing` as for `closed_loop_of`.
    """
    made = state.running
    if observing is not None or not state.scene.seeing.correct or made is None or (
            threading_of(made) is None):
        return ''
    return ('in open loop: no cloud of the DLO was taken in on ~/observed_points shortly before, '
            'so that it is not looked at before the cut-out; without clouds it is not corrected '
            'either')


class ClosedLoopDrive:
    """Ticks a ThreadingLoop, has its work done, and keeps the State as it stands.

    Who ends what is executed does so in the State; the next tick tells the loop.

    Parameters
    ----------
    loop : ThreadingLoop
    worker : Worker
        Does the `work` of it: in this process a plan would hold up the commands.
    deadline : float
        Seconds that one `work` of it may take.
    """

    def __init__(self, loop: ThreadingLoop, worker: Worker, deadline: float) -> None:
        self._loop, self._worker, self._deadline = loop, worker, deadline
        self._lock = Lock()  # around the loop
        self._known: Execution | None = None  # what the State was told
        self._last: Execution | None = None   # of the loop, whose command went out
        self._computing: Callable[[], Any] | None = None
        self._aimed: Any = None
        self._failed = False  # whether a tick has

    def begun(self, state: State) -> State:
        """Return the State in which it waits for the first look."""
        assert state.execution is not None  # it was started
        self._known = replace(state.execution, phase='waiting', sent=state.execution.done)
        return replace(state, execution=self._known, looking=Looking())

    def tick(self, store: Store, health: Health, now: float, stamp: float) -> Execution | None:
        """Go on, at `now` s, `stamp` s on the stamps' clock; return what the State knows of it."""
        state = store.state
        with self._lock:
            execution = self._ticked(state, now, stamp)
            loop = self._loop
            looking = Looking(loop.phase.value, loop.tries, loop.promised)
            work = loop.work
            if loop.aimed is not None and loop.aimed is not self._aimed:
                self._aimed = loop.aimed
                health.corrected(loop.aimed.correction, loop.refusal)
        if np.isfinite(looking.promised):
            health.expected(looking.promised)
        if work is not None and work is not self._computing:
            self._computing = work
            Thread(target=self._compute, args=(work,), name='closed loop', daemon=True).start()
        self._known = execution
        known = store.change(lambda now: now.looked(state.execution, execution, looking)).execution
        # what was stopped meanwhile has the command before: out goes what the loop knows to go out
        return known and replace(known, sending=execution.sending, ahead=execution.ahead)

    def _ticked(self, state: State, now: float, stamp: float) -> Execution:
        loop, known = self._loop, state.execution
        assert known is not None and self._known is not None  # it was begun
        if known is not self._known and known.cause:
            loop.stop(stamp, known.cause, known.reason, known.phase == 'stopped')
            if loop.cause == known.cause:  # of which more may be known by now
                loop.reason = known.reason
        if state.heard is not None:
            loop.gripper(state.heard)
        try:
            loop.tick(stamp, now, state.enabled)
        except Exception as error:
            if self._failed:  # not even coming to rest works: what was told ahead ends at rest
                loop.end(stamp, cause_of(error), str(error))
            loop.stop(stamp, cause_of(error), str(error))
            self._failed = True
            if not isinstance(error, DloPlannerError):
                raise
        execution = loop.execution or loop.last or self._known
        if execution is self._last:  # nothing new goes out
            execution = replace(execution, sending=None)
        self._last = loop.last
        if loop.phase is Phase.DONE:
            return replace(execution, phase='succeeded', cause=Cause.DONE, reason='')
        if loop.phase is Phase.STOP:
            return replace(execution, phase='stopped', cause=loop.cause, reason=loop.reason)
        if loop.execution is None:  # it stands, and will go on
            return replace(execution, phase='waiting', cause=Cause.DONE, reason='')
        if execution.phase == 'stopping' and not loop.cause:  # to go back: what cancels it stops it
            return replace(execution, phase='running', cause=Cause.DONE, reason='')
        if loop.cause:  # of several reasons the first one
            return replace(execution, cause=loop.cause, reason=loop.reason)
        return execution

    def _compute(self, work: Callable[[], Any]) -> None:
        def wanted() -> bool:
            return self._loop.work is work

        try:
            result = persistent(partial(self._worker.result, work, wanted, self._deadline))
        except DeadlineExceeded as error:
            result = Refused(Cause.PLANNING_DEADLINE, f'no plan was found in {error.elapsed:.3g} s:'
                             ' expected threading.planning_deadline = '
                             f'{error.seconds:g} s at most')
        except Exception as error:  # whatever it is, the loop has to end by it
            result = error
        if result is not None:  # it is still wanted
            with self._lock:
                self._loop.finish(work, result)
