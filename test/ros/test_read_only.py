# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node where nothing can be written: nobody, without a home, in a read-only system."""

import shutil
import subprocess
import sys

import pytest
from planner_process import PATIENCE, ROOT, WIRE

# The system itself, read-only but for the devices, entered as nobody. Reading everything stays
# allowed: the interpreter may be installed where only root can look.
ENTER = """
set -e
mount --bind / /mnt
mount -o remount,ro,bind /mnt
mount --rbind /dev /mnt/dev
mount --rbind /proc /mnt/proc
cd /
exec chroot /mnt setpriv --reuid 65534 --regid 65534 --clear-groups \
    --inh-caps +dac_read_search --ambient-caps +dac_read_search \
    env -u HOME -u ROS_LOG_DIR -u ROS_HOME "$@"
"""
# A node that loads nothing, ended as soon as it is ready, and what proves plans beside it.
NODE = """
import os, signal, subprocess, sys
sys.path.insert(0, {root!r})
os.environ['PYTHONPATH'] = {root!r}
from dlo_planner.ros import main
for folder in ('/tmp', '/var/tmp', {root!r}):
    assert not os.access(folder, os.W_OK)
made = main._planner

def make():
    from dlo_planner.ros import node as planner
    planner.answers = lambda: None
    planner.proofs = planner.closed_loop = int
    subprocess.run([sys.executable, '-c', 'import dlo_planner.ros.worker'], check=True)
    node, executor = made()
    print(node.lifecycle_state, os.getuid(), flush=True)
    os.kill(os.getpid(), signal.SIGTERM)
    return node, executor

main._planner = make
sys.exit(main.main({arguments!r}))
"""


def inside(*command):
    """Run a command there; return the finished process."""
    return subprocess.run(['unshare', '-m', 'sh', '-c', ENTER, 'sh', *command], text=True,
                          capture_output=True, check=False, timeout=4 * PATIENCE)


@pytest.mark.sweep
def test_it_starts_and_ends_as_nobody_in_a_read_only_system(domain):
    if not shutil.which('unshare') or inside('true').returncode != 0:
        pytest.skip('this machine lets nobody make a read-only system')
    node = NODE.format(root=str(ROOT), arguments=['--ros-args', *WIRE])
    done = inside(sys.executable, '-c', node)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ['active', '65534']
    assert 'Traceback' not in done.stderr
