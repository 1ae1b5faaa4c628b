# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A process that ends with what needs it."""

import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

_PATIENCE = 10.0  # s


@contextmanager
def child(module: str, *arguments: str,
          env: Mapping[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run a Python module as a process; interrupt it at the end, and kill it if that is in vain.

    Parameters
    ----------
    module : str
        Its name.
    arguments : str
        For it.
    env : dict
        Environment.
    """
    process = subprocess.Popen([sys.executable, '-m', module, *arguments], env=dict(env))
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(timeout=_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
