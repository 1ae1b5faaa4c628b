# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How requests end, and how the node does: ~/status, the log, /diagnostics."""

import traceback
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Lock
from time import monotonic
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError
from dlo_planner.execute.causes import Cause, Refused, cause_of
from dlo_planner.identify.correction import Correction
from dlo_planner.ros.inputs import Frames, brief_text, named
from dlo_planner.ros.lifecycle import LATCHED, MOST_CALLS, LifecycleNode
from dlo_planner.ros.markers import MarkerCache
from dlo_planner.ros.state import Proof, Store
from dlo_planner.verify.report import ValidationReport
from msg_helpers.diagnostics import ERROR, OK, WARN, status_msg
from msg_helpers.poses import stamp_text

_RECENT = 50      # shapes over which rates and latencies are averaged
_STALE = 30.0     # s that an error stays the headline
_QUIET = 1.0      # s between lines of the log about the same thing
_MOST_TRACED = 10_000  # characters of a traceback
_CONVERGED = 1e-8  # residual
_COUNTED = ('poses received', 'shapes published', 'poses refused', 'plans made', 'plans refused',
            'jumps', 'clouds received', 'clouds refused', 'corrections')

_REPORTED = {  # figures of a ValidationReport
    'position_error': 'largest miss [m]', 'misalignment': 'largest misalignment [rad]',
    'residual': 'largest residual', 'stability': 'smallest stability',
    'clearance': 'smallest clearance [m]', 'bend_margin': 'smallest bend margin [1/m]',
    'contact_force': 'largest contact force [N]',
    'deviation': 'largest deviation from the plan [m]',
    'workspace_margin': 'smallest workspace margin [m]',
    'tolerance': 'tolerance in motion [m]',
    'max_tracking_error': 'largest miss in motion [m]', 'swing': 'largest swing in motion [m]',
    'arrival': 'swing at arrival [m]', 'departure': 'swing at departure [m]',
    'dynamic_clearance': 'smallest clearance in motion [m]',
    'dynamic_contact_force': 'largest contact force in motion [N]',
    'dynamic_bend_margin': 'smallest bend margin in motion [1/m]',
    'contact_lost': 'part of the time without its contact',
    'insertion_force': 'largest push into the bore, estimated [N]',
    'largest_friction': 'largest friction looked at',
    'mode_margin': 'frequency margin', 'duration': 'duration [s]'}


def figures_of(report: ValidationReport | None) -> dict[str, Any]:
    """Return the figures of a ValidationReport by their names, nan where it says nothing."""
    return {'not looked at': ', '.join(getattr(report, 'not_looked_at', ())) or 'none',
            **{text: float(getattr(report, name, np.nan)) for name, text in _REPORTED.items()}}


def proof_figures(proof: Proof) -> dict[str, Any]:
    """Return what /diagnostics says of a Proof."""
    return {'report': proof.state, 'report reason': proof.reason or 'none',
            **{f'report {name}': value for name, value in figures_of(proof.report).items()}}


class Statistics:
    """Counters, rates, latencies, figures and the last error of the node; for any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._counts = dict.fromkeys(_COUNTED, 0)
        self._arrivals: deque[float] = deque(maxlen=_RECENT)
        self._latencies: deque[float] = deque(maxlen=_RECENT)
        self._figures: dict[str, Any] = {}
        self._shape: Shape | None = None  # its error estimate takes longer than the shape
        self._error, self._error_time = '', -np.inf

    def count(self, name: str) -> None:
        """Add one to the counter `name`."""
        with self._lock:
            self._counts[name] += 1
            if name == 'poses received':
                self._arrivals.append(monotonic())

    def shape_done(self, shape: Shape, seconds: float) -> None:
        """Take the figures of a published Shape that took `seconds`."""
        with self._lock:
            self._counts['shapes published'] += 1
            self._counts['jumps'] += shape.jumped
            self._latencies.append(seconds)
            self._shape = shape

    def note(self, figures: Mapping[str, Any]) -> None:
        """Take figures by name, in place of those before."""
        with self._lock:
            self._figures |= figures

    def corrected(self, correction: Correction, reason: str) -> None:
        """Take a Correction, and why it is not executed or ''."""
        if not reason:
            self.count('corrections')
        self.note({'correction': reason or 'executed', 'correction miss bound [m]':
                   float(correction.miss.bound.max(initial=0.0))})

    def failed(self, reason: str) -> None:
        """Take the reason of a refusal or failure."""
        with self._lock:
            self._error, self._error_time = reason, monotonic()

    def report(self) -> tuple[bytes, str, dict[str, Any]]:
        """Return level, message and values for `msg_helpers.diagnostics.diagnostics_msg`."""
        with self._lock:
            values: dict[str, Any] = {**self._counts, **self._figures,
                                      'last error': self._error or 'none'}
            arrivals, latencies = list(self._arrivals), list(self._latencies)
            shape, error, since = self._shape, self._error, self._error_time
        if len(arrivals) > 1:
            values['pose rate [Hz]'] = (len(arrivals) - 1) / max(arrivals[-1] - arrivals[0], 1e-9)
        if latencies:
            values |= {'latency median [ms]': 1e3 * float(np.median(latencies)),
                       'latency largest [ms]': 1e3 * max(latencies)}
        if shape is not None:
            values |= {'shape residual': shape.residual, 'shape stability': shape.stability,
                       'shape error estimate [m]': shape.error_estimate,
                       'shape iterations': shape.iterations}
        if error and monotonic() - since < _STALE:
            return WARN, error, values
        residual = 0.0 if shape is None else shape.residual
        if not residual < _CONVERGED:
            return ERROR, f'last shape did not converge: residual {residual:.3g}', values
        return OK, 'ready', values


@dataclass
class Outcome:
    """What is said of a request that is done."""

    stamp: Time  # of the request; None where nothing is told of it
    message: str = 'done'
    warning: str = ''  # what is not as one would wish, though it is done
    values: dict[str, Any] = field(default_factory=dict)


class Status:
    """Tells how requests ended: refused with a code, in one place; nothing leaves a callback."""

    def __init__(self, node: LifecycleNode, store: Store, statistics: Statistics) -> None:
        self._node, self._store, self._statistics = node, store, statistics
        self._log, self._traced = node.get_logger(), set[Any]()
        self._written: dict[object, float] = {}  # when a line of each kind was, s
        self._out = node.add_publisher(DiagnosticStatus, '~/status', LATCHED)

    @contextmanager
    def answering(self, what: str, *, stamp: Time | None = None, answer: Any = None,
                  counter: str | None = None, told: bool = True,
                  stream: bool = False) -> Iterator[Outcome]:
        """Let no exception out of a callback: refuse with a reason, keep the last good output.

        Of a `stream` of messages a refusal alone is told, as often as it is written.
        """
        if told and stamp is None:
            stamp = self._node.get_clock().now().to_msg()
        outcome = Outcome(stamp)
        try:
            yield outcome
        except Exception as error:  # an exception that leaves a callback ends the node
            cause, reason = self._refusal(what, error)
            if counter is not None:
                self._statistics.count(counter)
            written = self.failed(what, cause, reason)
            if told and (written or not stream):
                self.tell(what, cause, reason, stamp)
        else:
            cause, warning = Cause.DONE, outcome.warning
            reason = '; '.join(filter(None, (outcome.message, warning)))
            if warning:
                self.warn(what, f'{what}: {warning}')
            if told and not stream:
                self.tell(what, cause, reason, stamp, outcome.values, bool(warning))
        if answer is not None:
            answer.success, answer.message = cause == Cause.DONE, reason

    def _refusal(self, what: str, error: Exception) -> tuple[Cause, str]:
        """Return Cause and reason of an exception; an unknown one is traced once."""
        cause = cause_of(error)
        if isinstance(error, DloPlannerError):
            return cause, named(brief_text(f'{what} refused: {error}'))
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = type(error).__name__, last.filename, last.lineno
        if place not in self._traced:
            self._traced.add(place)
            self._log.error(brief_text(''.join(traceback.format_exception(error)),
                                       _MOST_TRACED))
        return cause, brief_text(f'{what} failed: {type(error).__name__}: {error}')

    def crowded(self, what: str, request: Any, response: Any) -> Any:
        """Refuse a call, since too many wait before it; return its answer."""
        stamps = [getattr(request, name).header.stamp for name in ('goal', 'start')
                  if hasattr(request, name)]
        given = (stamp for stamp in stamps if stamp.sec or stamp.nanosec)
        with self.answering(what, stamp=next(given, None),
                            answer=response if hasattr(response, 'message') else None):
            raise Refused(Cause.TOO_MANY_CALLS, f'{MOST_CALLS} calls wait before this one: '
                          'expected it when some of them are answered')
        return response

    def tell(self, what: str, cause: Cause, message: str, stamp: Time | None,
             values: Mapping[str, object] | None = None, warns: bool = False) -> None:
        """Publish the outcome of a request on ~/status."""
        level = ERROR if cause == Cause.INTERNAL else (
            OK if cause == Cause.DONE and not warns else WARN)
        self._out.publish(status_msg(
            f'{self._node.known_as}: {what}', self._store.state.scene['rod.name'], level,
            message, {'request': what, 'stamp': stamp_text(stamp), 'code': int(cause),
                      'cause': cause.name, **(values or {})}))

    def failed(self, what: str, cause: Cause, reason: str) -> bool:
        """Take a refusal or failure to diagnostics and the log; return whether it is written."""
        self._statistics.failed(reason)
        return self.warn((what, cause), reason)

    def warn(self, key: object, text: str) -> bool:
        """Write a warning, at most once a second of each kind; return whether it is written."""
        now = monotonic()
        if now - self._written.get(key, -np.inf) < _QUIET:
            return False
        self._written[key] = now
        self._log.warning(' '.join(brief_text(text).split()))
        return True

    def info(self, text: str) -> None:
        """Write a line."""
        self._log.info(' '.join(brief_text(text).split()))


@dataclass(frozen=True)
class Shared:
    """What all parts of a configured node work with."""

    node: LifecycleNode
    store: Store
    statistics: Statistics
    status: Status
    markers: MarkerCache
    frames: Frames


class Part:
    """A part of the node: some topics and services, in callback groups that it is given."""

    def __init__(self, shared: Shared) -> None:
        self.node, self.store, self.frames = shared.node, shared.store, shared.frames
        self.statistics, self.status, self.markers = (
            shared.statistics, shared.status, shared.markers)
