# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner doctor`: what is installed, what is missing, and what to do about it."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import NamedTuple

import click

from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.kernels import COMPILED, WANTED
from dlo_planner.settings.yaml_files import config_files

_NEEDED = {'numpy': (1, 26), 'scipy': (1, 11), 'numba': (0, 62), 'toppra': (0, 6)}
_EXTRAS = {  # extra -> (module, distribution, what it is for)
    'figures': ('matplotlib', 'matplotlib', 'pictures and films'),
    'scene': ('trimesh', 'trimesh', 'files of a cell: STL, OBJ, ...; MJCF, URDF'),
    'view': ('viser', 'viser', 'the page in the browser'),
    'mesh': ('trimesh', 'trimesh', 'meshes from files'),
    'cell': ('mujoco', 'mujoco', 'the cell: a physics engine'),
    'arm': ('pinocchio', 'pin', 'joints of a robot arm'),
    'cluster': ('distributed', 'distributed', 'many machines')}
_PYTHON = (3, 11)
_FEW = 150  # files of compiled kernels: fewer are not all
_PATIENCE = 60.0  # s for ROS to come up
_OK, _NOTE, _BAD = 'ok', 'note', 'bad'
_COLORS = {_OK: 'green', _NOTE: 'yellow', _BAD: 'red'}
_ROS = """
import rclpy
context = rclpy.Context()
rclpy.init(context=context)
rclpy.create_node('dlo_planner_doctor', context=context).destroy_node()
rclpy.try_shutdown(context=context)
"""


class Finding(NamedTuple):
    """What was looked at: ok, a note or bad; what was found; what to do ('' for nothing)."""

    state: str
    name: str
    found: str
    remedy: str = ''


@click.command('doctor')
def doctor() -> None:
    """Check versions, compiled kernels, extras and ROS; say what to do where something is amiss.

    \b
    ok    as it should be
    note  optional, and not there
    bad   has to be mended

    \b
    Example:
      dlo-planner doctor

    Exit code 3: something is bad.
    """
    bad = False
    for one in findings():
        bad |= one.state == _BAD
        mark = click.style(f'{one.state:4}', fg=_COLORS[one.state])
        click.echo(f'{mark}  {one.name:<22} {one.found}')
        if one.remedy:
            click.echo(f'{"":30}{one.remedy}')
    if bad:
        raise SystemExit(NO_SOLUTION)


def findings() -> Iterator[Finding]:
    """Yield what is found, one after the other."""
    yield _python()
    yield from (_needed(name, least) for name, least in _NEEDED.items())
    yield _kernels()
    yield _parameters()
    yield from (_extra(name, *rest) for name, rest in _EXTRAS.items())
    yield _ffmpeg()
    yield _ros()


def _python() -> Finding:
    present = '.'.join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] >= _PYTHON:
        return Finding(_OK, 'Python', present)
    return Finding(_BAD, 'Python', present, 'expected 3.11 or later: make an environment with it')


def _needed(name: str, least: tuple[int, ...]) -> Finding:
    try:
        present = version(name)
    except PackageNotFoundError:
        return Finding(_BAD, name, 'is not installed', f'pip install {name}')
    if tuple(map(int, re.findall(r'\d+', present)[:len(least)])) < least:
        return Finding(_BAD, name, present, f'pip install --upgrade "{name}>='
                       f'{".".join(map(str, least))}"')
    return Finding(_OK, name, present)


def _kernels() -> Finding:
    name = 'compiled kernels'
    if not COMPILED:
        return Finding(_BAD, name, 'numba is missing, too old or switched off: some hundred times '
                       'slower', f'pip install "{WANTED}"; unset NUMBA_DISABLE_JIT')
    from dlo_planner.kernels.files import folders  # noqa: PLC0415 - numba is needed
    known = folders()
    count = sum(1 for folder in known.read if folder.is_dir() for _ in folder.iterdir())
    if count < _FEW:
        return Finding(_NOTE, name, f'{count} so far',
                       'the first shape compiles them, for a minute or more: python -m '
                       'dlo_planner.prebuild compiles all')
    if known.write is None:
        return Finding(_NOTE, name, f'{count}; no folder can be written for others',
                       'set NUMBA_CACHE_DIR to a folder that can be written')
    return Finding(_OK, name, f'{count}, new ones in {known.write}')


def _parameters() -> Finding:
    names = ', '.join(config_files())
    if names:
        return Finding(_OK, 'DLOs by name', names)
    return Finding(_NOTE, 'DLOs by name', 'config/ is not installed',
                   'CONFIG has to be the path of a YAML file')


def _extra(name: str, module: str, distribution: str, purpose: str) -> Finding:
    if find_spec(module) is None:
        return Finding(_NOTE, f'extra {name}', f'is not installed: {purpose}',
                       f"pip install 'dlo_planner[{name}]'")
    try:
        return Finding(_OK, f'extra {name}', f'{distribution} {version(distribution)}: {purpose}')
    except PackageNotFoundError:
        return Finding(_OK, f'extra {name}', f'{module}: {purpose}')


def _ffmpeg() -> Finding:
    path = shutil.which('ffmpeg')
    if path:
        return Finding(_OK, 'ffmpeg', path)
    return Finding(_NOTE, 'ffmpeg', 'is not installed: films as MP4',
                   'apt install ffmpeg, or write films as .gif')


def _ros() -> Finding:
    """Look whether a ROS node can be made, in a process of its own."""
    sourced = os.environ.get('ROS_DISTRO', '')
    if find_spec('rclpy') is None:
        return Finding(_NOTE, 'ROS', 'rclpy is not there: the node', 'source '
                       '/opt/ros/jazzy/setup.bash, or pip install "ros-jazzy-rclpy[fastrtps]" '
                       'ros-jazzy-common-interfaces; everything else works without')
    try:
        done = subprocess.run([sys.executable, '-c', _ROS], capture_output=True, text=True,
                              timeout=_PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return Finding(_BAD, 'ROS', f'a node did not come up within {_PATIENCE:g} s',
                       'look at RMW_IMPLEMENTATION, ROS_DOMAIN_ID and the network')
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ['no message'])[-1]
        return Finding(_BAD, 'ROS', f'a node cannot be made: {reason}',
                       'source the setup.bash of ROS and of the workspace')
    return Finding(_OK, 'ROS', f'a node can be made ({sourced or "not sourced: wheels of PyPI"})')
