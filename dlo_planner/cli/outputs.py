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
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.summaries import rows_of

PICTURES, FILMS, VALUES = ('.png', '.svg', '.pdf'), ('.gif', '.mp4'), ('.npz', '.json')
POSES = ('.poses.yaml', '.poses.json')
_DPI = 150

Drawable = Shape | Plan | Motion | ValidationReport


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


def write(value: Drawable, outputs: Iterable[Path], **drawn: Any) -> None:
    """Write a value to files, and say which were written.

    Parameters
    ----------
    value : Shape or Plan or Motion or ValidationReport
        Shape, Plan, Motion, ValidationReport.
    outputs : iterable of Path
        Paths that are `checked`.
    drawn : object
        Arguments of `plot` and `animate`.
    """
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


def _poses(value: Drawable) -> Sequence[Pose]:
    if isinstance(value, Shape):
        return [value.at(s) for s in value.s]
    return value.grippers if isinstance(value, Plan) else ()


def _table(value: Drawable) -> tuple[tuple[str, ...], Sequence[Sequence[object]]]:
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
