# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A process of the node ends with it, whatever it computes."""

import os
import subprocess
import sys
import time
from pathlib import Path

from planner_process import PATIENCE, ROOT

# What computes for a minute; and a node that is killed as soon as that has begun.
CHILD = """
import os, threading, time
from dlo_planner.ros.worker import _end_with
threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
print(os.getpid(), flush=True)
time.sleep(60)
"""
PARENT = f"""
import os, signal, subprocess, sys
child = subprocess.Popen([sys.executable, '-c', {CHILD!r}], stdout=subprocess.PIPE, text=True,
                         start_new_session=True)
print(child.stdout.readline(), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def runs(number):
    """Return whether a process is there and is not only waiting to be counted."""
    try:
        return Path(f'/proc/{number}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def test_it_ends_when_the_node_is_killed():
    done = subprocess.run([sys.executable, '-c', PARENT], cwd=ROOT, capture_output=True, text=True,
                          check=False, timeout=PATIENCE,
                          env={**os.environ, 'PYTHONPATH': str(ROOT)})
    number = int(done.stdout)
    end = time.monotonic() + PATIENCE
    while runs(number) and time.monotonic() < end:
        time.sleep(0.05)
    assert not runs(number)
