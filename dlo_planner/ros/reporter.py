# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How requests end, said in one place: status topic, answers, log and diagnostics."""

import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from threading import Lock
from time import monotonic
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from dlo_planner.errors import DloPlannerError
from dlo_planner.execute.causes import Cause, cause_of
from dlo_planner.ros.door import brief_text, named
from dlo_planner.ros.gate import Gate
from dlo_planner.ros.health import Health, stamp_text
from dlo_planner.ros.qos import LATCHED
from dlo_planner.ros.state import Store
from msg_helpers.diagnostics import ERROR, OK, WARN, status_msg

_MOST_TRACED = 10_000  # characters of a traceback
_QUIET = 1.0  # s between lines of the log about the same thing


class Throttle:
    """Lets one line in a second through, of each kind; safe to use from several threads."""

    def __init__(self, quiet: float = _QUIET) -> None:
        self._quiet, self._lock = quiet, Lock()
        self._last: dict[object, float] = {}

    def passes(self, key: object, now: float) -> bool:
        """Whether a line of this kind may be written at `now` s."""
        with self._lock:
            if now - self._last.get(key, -np.inf) < self._quiet:
                return False
            self._last[key] = now
            return True


class Outcome:
    """What is said of a request that is done.

    Attributes
    ----------
    message : str
        One line.
    warning : str
        What is not as one would wish, though it is done; '': nothing. Added to the message.
    stamp : Time
        builtin_interfaces/Time of the request.
    values : dict
        What else there is to say, by name.
    """

    def __init__(self, stamp: Time) -> None:
        self.message, self.warning, self.stamp = 'done', '', stamp
        self.values: dict[str, Any] = {}


class Reporter:
    """Tells how requests ended.

    Parameters
    ----------
    node : Gate
        Rclpy Node.
    store : Store
    health : Health
    """

    def __init__(self, node: Gate, store: Store, health: Health) -> None:
        self._node, self._store, self._health = node, store, health
        self._log, self._throttle = node.get_logger(), Throttle()
        self._seen: set[Any] = set()
        self._out = node.create_publisher(DiagnosticStatus, '~/status', LATCHED)

    @contextmanager
    def answering(self, what: str, *, stamp: Time | None = None, answer: Any = None,
                  counter: str | None = None, told: bool = True) -> Iterator[Outcome]:
        """Let no exception out of a callback: refuse with a reason, keep the last good output.

        Parameters
        ----------
        what : str
            Is asked for.
        stamp : Time, optional
            builtin_interfaces/Time of the request, None: now.
        answer : object, optional
            Trigger response that carries the outcome.
        counter : str, optional
            Counter of refusals, in Health.
        told : bool, optional
            Whether the outcome goes to ~/status: it was a request.

        Yields
        ------
        iterator of Outcome
            Outcome, to be filled.
        """
        stamp = stamp or self._node.get_clock().now().to_msg()
        outcome = Outcome(stamp)
        try:
            yield outcome
        except Exception as error:  # an exception that leaves a callback ends the node
            cause, reason = self._refusal(what, error)
            if counter is not None:
                self._health.count(counter)
            self.failed(what, cause, reason)
            if told:
                self.tell(what, cause, reason, stamp)
        else:
            cause, warning = Cause.DONE, outcome.warning
            reason = '; '.join(filter(None, (outcome.message, warning)))
            if warning:
                self.warn(what, f'{what}: {warning}')
            if told:
                self.tell(what, cause, reason, stamp, outcome.values, bool(warning))
        if answer is not None:
            answer.success, answer.message = cause == Cause.DONE, reason

    def _refusal(self, what: str, error: Exception) -> tuple[Cause, str]:
        """Return Cause and reason of an exception; an unknown one is traced once."""
        cause = cause_of(error)
        if isinstance(error, DloPlannerError):
            return cause, named(brief_text(f'{what} refused: {error}'),
                                self._store.state.bodies)
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = type(error).__name__, last.filename, last.lineno
        if place not in self._seen:
            self._seen.add(place)
            self._log.error(brief_text(''.join(traceback.format_exception(error)),
                                       _MOST_TRACED))
        return cause, brief_text(f'{what} failed: {type(error).__name__}: {error}')

    def tell(self, what: str, cause: Cause, message: str, stamp: Time | None,
             values: Mapping[str, object] | None = None, warns: bool = False) -> None:
        """Publish the outcome of a request on ~/status.

        Parameters
        ----------
        what : str
            Was asked for.
        cause : Cause
        message : str
            One line.
        stamp : Time or None
            builtin_interfaces/Time of the request.
        values : dict, optional
            dict of what else there is to say.
        warns : bool, optional
            Whether it is done, but not as one would wish.
        """
        level = ERROR if cause == Cause.INTERNAL else (
            OK if cause == Cause.DONE and not warns else WARN)
        self._out.publish(status_msg(
            f'{self._node.get_name()}: {what}', self._store.state.scene.name, level, message,
            {'request': what, 'stamp': stamp_text(stamp), 'code': int(cause), 'cause': cause.name,
             **(values or {})}))

    def failed(self, what: str, cause: Cause, reason: str) -> None:
        """Take a refusal or failure to diagnostics and, at most once a second, to the log."""
        self._health.failed(reason)
        self.warn((what, cause), reason)

    def warn(self, key: object, text: str) -> None:
        """Write a warning, at most once a second of each kind."""
        if self._throttle.passes(key, monotonic()):
            self._log.warning(' '.join(brief_text(text).split()))

    def info(self, text: str) -> None:
        """Write a line."""
        self._log.info(' '.join(brief_text(text).split()))
