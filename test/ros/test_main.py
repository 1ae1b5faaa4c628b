# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The process: heard at any moment, status 0, one line instead of a traceback."""

import signal
import subprocess
import sys
import time

import pytest
from planner_process import PATIENCE, ROOT, in_time

# A process whose node is made by the code that is put in; it says 'begun' when that runs.
PROCESS = """
import sys, time
from dlo_planner.ros.main import Process

class Node:
    def end(self):
        print('ended', flush=True)
    def destroy_node(self):
        print('destroyed', flush=True)

class Executor:
    def add_node(self, node):
        pass
    def spin(self):
        self.on = True
        while self.on:
            time.sleep(0.01)
    def shutdown(self):
        self.on = False
    def wait_for_callbacks(self):
        pass

def make():
    print('begun', flush=True)
    {code}
    return Node(), Executor()

sys.exit(Process(make, []).run())
"""
BUSY = 'import re\n    while True: re.compile("(a|b)*c")'  # never waits, as a compiler
QUICK = 4.0  # s in which a signal is answered; what does not end is left after 6 s


def started(code):
    process = subprocess.Popen([sys.executable, '-c', PROCESS.format(code=code)], cwd=ROOT,
                               bufsize=0,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline() == b'begun\n'
    return process


def ended(process, *signals):
    """Send signals, 50 ms apart; return status, what was printed, and the s it took."""
    begun = time.monotonic()
    for number in signals:
        process.send_signal(number)
        time.sleep(0.05)
    try:
        out, err = process.communicate(timeout=0.9 * PATIENCE)
    finally:
        process.kill()
    return process.returncode, out.decode().split(), err.decode(), time.monotonic() - begun


@pytest.mark.every(5)
@pytest.mark.parametrize('signals', [
    [signal.SIGINT], [signal.SIGTERM], [signal.SIGINT, signal.SIGINT],
    [signal.SIGTERM, signal.SIGINT, signal.SIGTERM]], ids=lambda found: '+'.join(
        one.name for one in found))
@pytest.mark.parametrize('code', ['pass', 'time.sleep(60)', BUSY],
                         ids=['spinning', 'waiting', 'busy'])
def test_every_signal_is_heard_at_any_moment(code, signals):
    def took():
        process = started(code)
        time.sleep(0.1)
        status, out, err, seconds = ended(process, *signals)
        assert (status, err) == (0, '')
        assert out == (['ended', 'destroyed'] if code == 'pass' else [])
        return seconds
    assert in_time(took, QUICK)


def test_a_signal_that_another_thread_takes_is_heard():
    process = started('import signal, threading; '
                      'signal.pthread_kill(threading.get_ident(), signal.SIGTERM)')
    status, out, err, _ = ended(process)
    assert (status, err) == (0, '') and out[-1:] in ([], ['destroyed'])


def test_a_callback_that_goes_on_computing_is_abandoned():
    def took():
        process = started('Executor.wait_for_callbacks = lambda self: time.sleep(60)')
        time.sleep(0.1)
        status, out, err, seconds = ended(process, signal.SIGTERM)
        assert (status, out, err) == (0, ['ended'], '')
        return seconds
    assert in_time(took, QUICK)


def test_a_motion_may_come_to_rest_before_the_rest_is_ended():
    process = started('Node.end = lambda self: (time.sleep(2.0), print("ended", flush=True))')
    time.sleep(0.1)
    status, out, err, seconds = ended(process, signal.SIGINT)
    assert (status, out, err) == (0, ['ended', 'destroyed'], '')
    assert seconds > 2.0


def test_a_refusal_to_start_is_one_line():
    process = started('from dlo_planner import InvalidTask; raise InvalidTask("odd value")')
    status, _, err, _ = ended(process)
    assert (status, err) == (1, 'dlo_planner: cannot start: odd value\n')


def test_an_unknown_error_is_traced_and_fails():
    process = started('Executor.spin = lambda self: 1 / 0')
    status, out, err, _ = ended(process)
    assert status == 1
    assert 'ZeroDivisionError' in err and out == ['destroyed']
