# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A planner node as a real process, a client that talks to it, and queues of what came."""

import contextlib
import os
import queue
import signal
import subprocess
import sys
from pathlib import Path

from dlo_planner.ros.client import PlannerClient

ROOT = Path(__file__).parent.parent


class Planner:
    """A running planner process; its log is in `log`."""

    def __init__(self, directory, *arguments):
        self.log_file = directory / 'planner.log'
        with self.log_file.open('w') as log:
            self.process = subprocess.Popen(
                [sys.executable, '-m', 'dlo_planner.ros.planner_node', '--ros-args', *arguments],
                stdout=log, stderr=subprocess.STDOUT, cwd=ROOT,
                env={**os.environ, 'PYTHONUNBUFFERED': '1'})

    @property
    def log(self):
        """Everything that it has printed so far."""
        return self.log_file.read_text()

    def alive(self):
        """Whether it runs."""
        return self.process.poll() is None

    def interrupt(self, *signals):
        """Send SIGINT, or these signals 0.1 s apart; return the exit status."""
        for number in signals or (signal.SIGINT,):
            self.process.send_signal(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(timeout=0.1)
        return self.process.wait(timeout=20)


@contextlib.contextmanager
def running_planner(directory, *arguments):
    """Run a planner process; end it at the end, come what may."""
    planner = Planner(directory, *arguments)
    try:
        yield planner
    finally:
        if planner.alive():
            try:
                planner.interrupt()
            except subprocess.TimeoutExpired:
                planner.process.kill()


@contextlib.contextmanager
def connected_client(planner, name='/dlo_planner'):
    """Yield a PlannerClient once the planner, a node with this name, answers."""
    client = PlannerClient(name)
    try:
        assert client.wait_until_ready(400.0, planner.alive), planner.log
        yield client
    finally:
        client.close()


def drain(messages):
    """Empty the queue; return what was in it."""
    taken = []
    while True:
        try:
            taken.append(messages.get_nowait())
        except queue.Empty:
            return taken


def newest(messages, timeout=10.0):
    """Wait for a message; return the last one there is."""
    first = messages.get(timeout=timeout)
    return (drain(messages) or [first])[-1]
