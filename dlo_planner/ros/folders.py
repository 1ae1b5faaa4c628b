# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders to write in, where the usual ones cannot be: no home, a read-only system."""

import os
import tempfile
from pathlib import Path

_IN_MEMORY = Path('/dev/shm')  # a container has it though all else is read-only
_NO_FILE = ['--ros-args', '--disable-external-lib-logs']


def find_temporary() -> None:
    """Take the folder in memory for temporary files, where there is no other one.

    Child processes take it as well. Libraries write there what they keep from one start to the
    next, if there is no home; some do not load where they cannot.
    """
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        if _can_be_written(_IN_MEMORY):
            os.environ['TMPDIR'] = tempfile.tempdir = str(_IN_MEMORY)


def log_arguments() -> list[str]:
    """Choose the folder of the ROS log; return the arguments that `rclpy.init` needs for it.

    ROS takes ROS_LOG_DIR, ROS_HOME/log or HOME/.ros/log and refuses to start if it cannot write
    there. Then ROS_LOG_DIR becomes a folder among temporary files; where there is none either, the
    log goes to the console only.
    """
    if _can_be_written(_usual()):
        return []
    try:
        folder = Path(tempfile.gettempdir()) / f'dlo_planner-log-{os.getuid()}'
    except OSError:
        return _NO_FILE
    if not _can_be_written(folder):
        return _NO_FILE
    os.environ['ROS_LOG_DIR'] = str(folder)
    return []


def _usual() -> Path | None:
    for name, below in (('ROS_LOG_DIR', ''), ('ROS_HOME', 'log'), ('HOME', '.ros/log')):
        if os.environ.get(name):
            return Path(os.environ[name]).expanduser() / below
    return None


def _can_be_written(folder: Path | None) -> bool:
    if folder is None:
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError):  # ~ without a home
        return False
    return True
