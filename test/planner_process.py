# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A planner node as a real process, a client that talks to it, and queues of what came."""

import contextlib
import os
import queue
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from planner_client import PlannerClient, drain

from msg_helpers.poses import pose_from_msg

ROOT = Path(__file__).parent.parent
WIRE = ('--params-file', str(ROOT / 'config' / 'copper_wire.yaml'))  # where no other DLO is given
PATIENCE = 60.0  # s to wait for what has to come: a busy machine is late, a fault is for good
DEEPEST = 0.4  # of the length, so far is threaded: a proof simulates all of the motion
TRIES = 3        # to keep a limit of time: a busy machine spoils it now and then, a fault always
# Guards of time and tracking, for a robot in a busy process; their own tests need no process.
ROOM = {'incoming_command_timeout': 2.0, 'execute.longest_pause': 2.0,
        'constraints.path.position': 0.5, 'constraints.path.angle': 1.0,
        'constraints.goal_time': 20.0, 'threading.deadline': 300.0}


# Ends with the tests, however those end: its domain is free then, and others would hear it.
ENDS_WITH_US = ('setpriv', '--pdeathsig', 'TERM') if shutil.which('setpriv') else ()


class Planner:
    """A running planner process; its log is in `log`."""

    def __init__(self, directory, *arguments):
        self.log_file = directory / 'planner.log'
        # of two files rcl takes the second one's values, whatever is said after it
        wire = () if '--params-file' in arguments else WIRE
        with self.log_file.open('w') as log:
            self.process = subprocess.Popen(
                [*ENDS_WITH_US, sys.executable, '-m', 'dlo_planner.ros.main', '--ros-args', *wire,
                 *arguments],
                stdout=log, stderr=subprocess.STDOUT, cwd=ROOT,
                env={**os.environ, 'PYTHONUNBUFFERED': '1'})

    @property
    def log(self):
        return self.log_file.read_text()

    def alive(self):
        return self.process.poll() is None

    def heeds(self, number):
        """Whether it has a handler for a signal, which Python does not set by itself."""
        return heeds(self.process.pid, number)

    def interrupt(self, *signals):
        """Send SIGINT, or these signals 0.1 s apart; return the exit status."""
        for number in signals or (signal.SIGINT,):
            self.process.send_signal(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(timeout=0.1)
        return self.process.wait(timeout=PATIENCE)


def heeds(process, number):
    """Whether a process (its number) has a handler for a signal."""
    status = Path(f'/proc/{process}/status').read_text()
    caught = next(line.split()[1] for line in status.splitlines() if 'SigCgt' in line)
    return bool(int(caught, 16) >> number - 1 & 1)


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
    client = PlannerClient(name, timeout=PATIENCE)
    try:
        assert client.wait_until_ready(400.0, planner.alive), planner.log
        yield client
    finally:
        client.close()


def options(values):
    """Return the parts of a command line that give these values (name -> value)."""
    return [part for name, value in values.items() for part in ('-p', f'{name}:={value}')]


def until(wanted, timeout=PATIENCE):
    """Wait until `wanted()`; return whether it is."""
    end = time.monotonic() + timeout
    while not wanted() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(wanted())


def quiet(messages, seconds=1.0):
    """Return what is in the queue once nothing has come for so many s; it must end some time."""
    taken, end = [], time.monotonic() + PATIENCE
    with contextlib.suppress(queue.Empty):
        while True:
            taken.append(messages.get(timeout=seconds))
            assert time.monotonic() < end, 'messages do not end'
    return taken


def first(messages, wanted, timeout=PATIENCE):
    """Return the first message of the queue that is `wanted(message)`; others are left out."""
    end = time.monotonic() + timeout
    while not wanted(message := messages.get(timeout=max(end - time.monotonic(), 0.0))):
        pass
    return message


def under_way(client, path):
    """Prove and execute a plan for 2 s; return the largest step of its way in a period, m."""
    assert client.proof(path)['report'] == 'held'
    speeds = [np.linalg.norm([v.x, v.y, v.z]) for v in (
        point.velocities[0].linear for point in client.timed_for(path).points)]
    for messages in (client.commands, client.executions, client.statuses):
        drain(messages)
    assert client.trigger('execute').success
    assert until(lambda: float(  # at the top speed of such a motion about
        client.execution_in('running')[2]['done [s]']) >= 2.0)
    return 0.02 * max(speeds)


def steps(client):
    """Return how far each command is from the one before, m."""
    places = [pose_from_msg(one.pose).position for one in quiet(client.commands)]
    return np.linalg.norm(np.diff(places, axis=0), axis=1)


def in_time(attempt, limit):
    """Return whether one of a few calls of `attempt()`, which returns s, keeps the limit in s."""
    return any(attempt() < limit for _ in range(TRIES))


def newest(messages, timeout=PATIENCE):
    """Wait for a message; return the last one there is."""
    first = messages.get(timeout=timeout)
    return (drain(messages) or [first])[-1]
