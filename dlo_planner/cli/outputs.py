# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What `-o` writes: pictures, films, values, tables, poses; by the ending of the file's name."""

import csv
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.files import writable
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.settings.guarded_yaml import yaml_of
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.summaries import rows_of

PICTURES, FILMS, VALUES = ('.png', '.svg', '.pdf'), ('.gif', '.mp4'), ('.npz', '.json')
POSES = ('.poses.yaml', '.poses.json')
_DPI = 150

Writable = Shape | Plan | Motion | ValidationReport | Trajectory


def checked(outputs: Iterable[Path], endings: Iterable[str]) -> None:
    """Refuse, before anything is computed, what cannot be written.

    Parameters
    ----------
    outputs : iterable of Path
        Paths.
    endings : iterable of str
        Endings that the command knows.

    Raises
    ------
    InvalidTask
        Another ending, or no such folder.
    MissingExtra
        Matplotlib is not installed.
    """
    endings = tuple(endings)
    for path in map(writable, outputs):
        if not path.name.lower().endswith(endings):
            raise InvalidTask(f'-o {path}: expected a file that ends with one of '
                              f'{" ".join(endings)}')
        if not path.parent.is_dir():
            raise InvalidTask(f'-o {path}: expected a folder that exists, {path.parent} does not')
        if path.suffix.lower() in PICTURES + FILMS:
            extra('matplotlib', 'figures', 'pictures').use('Agg')


def write(value: Writable, outputs: Iterable[Path], rate: float = 50.0, **drawn: Any) -> None:
    """Write a value to files, and say which were written.

    Parameters
    ----------
    value : Shape or Plan or Motion or ValidationReport or Trajectory
    outputs : iterable of Path
        Paths that are `checked`.
    rate : float, optional
        Poses a second of a Trajectory.
    drawn : object
        Arguments of `plot` and `animate`.
    """
    if isinstance(value, Trajectory):
        _write_motion(value, outputs, rate)
        return
    for path in outputs:
        kind = path.suffix.lower()
        if path.name.lower().endswith(POSES):
            write_poses(path, _poses(value))
        elif kind in PICTURES:
            value.plot(**drawn).savefig(path, dpi=_DPI)
        elif kind in FILMS and isinstance(value, Plan | Motion):
            value.animate(path, **drawn)
        elif kind in VALUES:
            value.save(path)
        else:
            write_table(path, *_table(value))
        click.echo(f'wrote {path}')


def _write_motion(trajectory: Trajectory, outputs: Iterable[Path], rate: float) -> None:
    """Write the gripper's motion, poses at even times: .csv, .json, or the poses alone."""
    times = np.linspace(0.0, trajectory.duration, max(2, round(trajectory.duration * rate) + 1))
    poses, velocities, _ = trajectory.at(times)
    head = ('time', *'xyz', 'qx', 'qy', 'qz', 'qw', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz')
    rows = np.column_stack([times, [[*pose.position, *pose.quaternion] for pose in poses],
                            velocities])
    for path in outputs:
        if path.name.lower().endswith(POSES):
            write_poses(path, poses)
        elif path.suffix.lower() == '.json':
            path.write_text(json.dumps(dict(zip(head, rows.T.tolist(), strict=True))),
                            encoding='utf-8')
        else:
            write_table(path, head, rows.tolist())
        click.echo(f'wrote {path}: {trajectory.duration:.4g} s')


def write_table(path: Path, head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a CSV file."""
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(rows)


def write_poses(path: Path, poses: Iterable[Pose]) -> None:
    """Write poses as geometry_msgs/Pose[], as MoveIt takes waypoints: YAML or JSON."""
    content = [{'position': dict(zip('xyz', pose.position.tolist(), strict=True)),
                'orientation': dict(zip('xyzw', pose.quaternion.tolist(), strict=True))}
               for pose in poses]
    text = (json.dumps(content, indent=1) if path.suffix.lower() == '.json'
            else yaml_of(content))
    path.write_text(text, encoding='utf-8')


def _poses(value: Shape | Plan | Motion | ValidationReport) -> Sequence[Pose]:
    if isinstance(value, Shape):
        return [value.at(s) for s in value.s]
    return value.grippers if isinstance(value, Plan) else ()


def _table(value: Shape | Plan | Motion | ValidationReport,
           ) -> tuple[tuple[str, ...], Sequence[Sequence[object]]]:
    """Return the heading and the rows of a value."""
    if isinstance(value, Shape):
        quaternions = [value.at(s).quaternion for s in value.s]
        return (('s', *'xyz', 'qx', 'qy', 'qz', 'qw', 'torsion', 'curvature_n', 'curvature_b'),
                np.column_stack([value.s, value.positions, quaternions, value.strains]).tolist())
    if isinstance(value, Plan):
        poses = [[*pose.position, *pose.quaternion] for pose in value.grippers]
        return (('time', 'depth', *'xyz', 'qx', 'qy', 'qz', 'qw', 'miss', 'misalignment',
                 'clearance', 'stability', 'residual'),
                np.column_stack([value.times, value.depths, poses, value.position_error,
                                 value.misalignment,
                                 value.clearance, value.stability, value.residual]).tolist())
    return ('quantity', 'value', 'unit'), rows_of(value)
