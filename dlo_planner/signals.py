# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""SIGINT and SIGTERM in processes of this package: they end without a traceback.

A KeyboardInterrupt is raised wherever Python stands: in an import, in the midst of an end, in each
process that a terminal reaches. Here a signal is news instead.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

NUMBERS = (signal.SIGINT, signal.SIGTERM)


def end_at_once() -> None:
    """Let Ctrl-C end this process without a traceback, where nobody hears it yet: as it starts."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def heard() -> list[int]:
    """Return the signals that come from now on, empty as long as there is none."""
    came: list[int] = []
    for number in NUMBERS:
        signal.signal(number, lambda number, _: came.append(number))
    return came


def ignore() -> None:
    """Ignore signals from now on: one more Ctrl-C must not spoil the end of the interpreter."""
    for number in NUMBERS:
        signal.signal(number, signal.SIG_IGN)


def leave_to_parent() -> None:
    """Ignore Ctrl-C in a process that others end: the terminal sends it to all of a group."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def held_back() -> Iterator[None]:
    """Let a process that is started meanwhile hear no SIGINT until it calls `let_through`."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def let_through() -> None:
    """Hear what `held_back` held back, by the handler that is set now."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
