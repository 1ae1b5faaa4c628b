# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What subcommands read and write: arguments, files of poses and obstacles, pictures, tables."""

import csv
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from dlo_planner.direct.grasp import Simulator
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import vector
from dlo_planner.model.files import writable
from dlo_planner.model.plain_poses import pose_of, pose_of_numbers
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import doubts
from dlo_planner.model.triangles import UNITS
from dlo_planner.plan.plan import Plan
from dlo_planner.scene import Scene
from dlo_planner.settings.build import direct_of, grasped_of
from dlo_planner.settings.yaml_files import read_values, read_yaml, yaml_of
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.summary import rod_line, rows_of

_BAR_WIDTH = 30  # of a progress bar


def _pose(text: str) -> Pose:
    try:
        return pose_of_numbers('pose', [float(one) for one in text.split(',')])
    except (DloPlannerError, ValueError) as error:
        raise click.BadParameter(f'{text!r}: expected X,Y,Z, X,Y,Z,DX,DY,DZ or '
                                 f'X,Y,Z,QX,QY,QZ,QW; {error}') from None


def _vector(text: str) -> Floats:
    try:
        return vector('vector', [float(one) for one in text.split(',')], 3)
    except (DloPlannerError, ValueError) as error:
        raise click.BadParameter(f'{text!r}: expected X,Y,Z; {error}') from None


# of options
POSE: dict[str, Any] = {'type': _pose, 'metavar': 'X,Y,Z[,...]'}
VECTOR: dict[str, Any] = {'type': _vector, 'metavar': 'X,Y,Z'}
READ = click.Path(exists=True, dir_okay=False, path_type=Path)


SCENE_OPTIONS = (  # how files of a scene are read
    click.option('--hulls', is_flag=True, help='Take triangles of it that do not enclose a solid '
                 'as their convex hull.'),
    click.option('--joint', 'joints', multiple=True, metavar='NAME=VALUE',
                 help='Where a joint of an MJCF or URDF stands, m or rad; may be repeated.'),
    click.option('--scene-at', **POSE, help='Where the frame of the scene stands in the world.'),
    click.option('--scene-unit', type=click.Choice(list(UNITS)),
                 help='Unit of its lengths. Default: what the file or its format says; of STL, '
                 'OBJ and PLY, which say none, mm.'))


def described(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the argument CONFIG and the options that say what the DLO and its surroundings are.

    What they describe, a Described, is the first argument of the command.
    """
    @wraps(command)
    def reading(config: str, changes: tuple[str, ...], scenes: tuple[Path, ...],
                scene_unit: str | None, scene_at: Pose | None, joints: tuple[str, ...],
                hulls: bool, **options: Any) -> object:
        values, warnings = read_values(config, changes)
        friction, stated = values['obstacles.friction'], values['scene.file']
        scene = read_scene([Path(stated)] if stated else [], friction=friction).joined(
            read_scene(scenes, scene_unit, scene_at, joints_of(joints), friction, hulls=hulls))
        return command(read_described(values, warnings, scene), **options)

    for decorator in (
            *SCENE_OPTIONS,
            click.option('--scene', '--obstacles', 'scenes', type=READ, metavar='FILE',
                         multiple=True, help='What is around the DLO: a file of MoveIt (.scene), '
                         'MJCF (.xml), URDF, triangles (.stl .obj .ply .glb .3mf), or a YAML list '
                         'of obstacles (box, sphere, sheet, ..., file). May be repeated.'),
            click.option('-p', '--parameter', 'changes', multiple=True, metavar='NAME=VALUE',
                         help='A parameter that counts more than the file, as rod.length=0.8.'),
            click.argument('config')):
        reading = decorator(reading)
    return reading


def written(kinds: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add the option -o; `kinds` says what its endings mean."""
    return click.option('-o', '--output', 'outputs', multiple=True, metavar='FILE',
                        type=click.Path(dir_okay=False, path_type=Path),
                        help=f'Write a file; may be repeated. Its ending says what: {kinds}.')


class Described(NamedTuple):
    """What CONFIG and its options describe."""

    values: dict[str, Any]  # Values of all parameters
    direct: DirectSimulator  # of the DLO held at its beginning
    scene: Scene  # what is around it

    @property
    def held(self) -> Simulator:
        """The simulator of the DLO held where the parameter rod.grasped_at says."""
        return grasped_of(self.values, self.direct) or self.direct

    @property
    def rod_line(self) -> str:
        """What the DLO is, in a line."""
        return rod_line(self.direct.rod, self.direct.gravity, self.values['rod.name'])


def read_described(values: dict[str, Any], warnings: list[str], scene: Scene) -> Described:
    """Return what CONFIG and its options describe; warn of what has no effect or is doubtful."""
    direct = direct_of(values, scene.obstacles)
    for warning in warnings + doubts(direct.rod, direct.gravity):
        click.echo(f'warning: {warning}', err=True)
    return Described(values, direct, scene)


class Bar:
    """A progress bar on standard error, where that is a terminal; give it as `progress=`."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._bar: Any = None
        self._total = 0
        self._shown = sys.stderr.isatty()

    def __call__(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are finished; a new total is a new bar."""
        if not self._shown:
            return
        if self._bar is None or total != self._total or done < self._bar.pos:
            self.close()
            self._total = total
            self._bar = click.progressbar(length=total, label=self._label, width=_BAR_WIDTH,
                                          file=sys.stderr)
            self._bar.__enter__()
        self._bar.update(done - self._bar.pos)

    def close(self) -> None:
        """End the line."""
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
            self._bar = None

    def __enter__(self) -> 'Bar':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_poses(path: Path) -> list[Pose]:
    """Return the Poses of a YAML or JSON file: a list of poses, as `-o x.poses.yaml` writes it."""
    content = read_yaml(path)
    if isinstance(content, dict):
        content = content.get('poses')
    if not isinstance(content, list) or not content:
        raise InvalidTask(f'{path}: expected a list of poses')
    return [pose_of(f'{path}[{k}]', one) for k, one in enumerate(content)]


def read_scene(paths: Iterable[Path], unit: str | None = None, pose: Pose | None = None,
               joints: Mapping[str, Any] | None = None, friction: float = 0.0, *,
               hulls: bool = False, counted: bool = True) -> Scene:
    """Return the Scene of files; say how much was read (`counted`) and how."""
    scene = Scene()
    for path in paths:
        part = Scene.read(path, unit, pose=Pose.identity() if pose is None else pose,
                          friction=friction, joints=joints, hulls=hulls)
        if counted:
            click.echo(f'{path}: {part.counts}', err=True)
        for note in part.notes:
            click.echo(f'note: {note}', err=True)
        scene = scene.joined(part)
    return scene


def joints_of(given: Iterable[str]) -> dict[str, float]:
    """Return what options NAME=VALUE say."""
    joints = {}
    for one in given:
        name, sign, text = one.rpartition('=')
        try:
            joints[name] = float(text)
        except ValueError:
            sign = ''
        if not sign or not name:
            raise InvalidTask(f'--joint {one!r}: expected NAME=VALUE, in m or rad')
    return joints


PICTURES, FILMS, VALUES = ('.png', '.svg', '.pdf'), ('.gif', '.mp4'), ('.npz', '.json')
POSES = ('.poses.yaml', '.poses.json')
SCENES = ('.scene', '.xml')
_PLACED = (*'xyz', 'qx', 'qy', 'qz', 'qw')  # columns of a table
_MOVED = (*_PLACED, 'vx', 'vy', 'vz', 'wx', 'wy', 'wz')
_DPI = 150

Writable = Shape | Plan | Motion | ValidationReport | Trajectory


def checked(outputs: Iterable[Path], endings: Iterable[str]) -> None:
    """Refuse, before anything is computed, what cannot be written."""
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
    """Write a value to files, and say which were written."""
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
        elif kind in SCENES and isinstance(value, Shape):
            Scene().with_dlo(value).write(path)
        else:
            write_table(path, *_table(value))
        click.echo(f'wrote {path}')


def _write_motion(trajectory: Trajectory, outputs: Iterable[Path], rate: float) -> None:
    """Write the gripper's motion, poses at even times: .csv, .json, or the poses alone.

    Columns of the other arms have their names before them.
    """
    times = np.linspace(0.0, trajectory.duration, max(2, round(trajectory.duration * rate) + 1))
    poses, velocities, _ = trajectory.at(times)
    head: tuple[str, ...] = ('time', *_MOVED)
    columns = [times[:, None], _rows_of(poses), velocities]
    for name in trajectory.path.arms:
        places, speeds, _ = trajectory.arm(name).at(times)
        head += tuple(f'{name} {column}' for column in _MOVED)
        columns += [_rows_of(places), speeds]
    rows = np.hstack(columns)
    for path in outputs:
        if path.name.lower().endswith(POSES):
            write_poses(path, poses)
        elif path.suffix.lower() == '.json':
            path.write_text(json.dumps(dict(zip(head, rows.T.tolist(), strict=True))),
                            encoding='utf-8')
        else:
            write_table(path, head, rows.tolist())
        click.echo(f'wrote {path}: {trajectory.duration:.4g} s')


def _rows_of(poses: Iterable[Pose]) -> Floats:
    """Return (n, 7) positions in m and quaternions of n Poses."""
    return np.array([[*pose.position, *pose.quaternion] for pose in poses])


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


def _inside(shape: Shape) -> Floats:
    """Return forces and moments (N_L + 1, 6) inside a Shape, N and N m; nan where not known."""
    try:
        return np.column_stack([shape.tension, shape.shear, shape.torque, shape.bending_moment])
    except InvalidTask:  # what did not converge is in no balance
        return np.full((len(shape.s), 6), np.nan)


def _table(value: Shape | Plan | Motion | ValidationReport,
           ) -> tuple[tuple[str, ...], Sequence[Sequence[object]]]:
    """Return the heading and the rows of a value."""
    if isinstance(value, Shape):
        quaternions = [value.at(s).quaternion for s in value.s]
        return (('s', *'xyz', 'qx', 'qy', 'qz', 'qw', 'torsion', 'curvature_n', 'curvature_b',
                 'tension', 'shear_n', 'shear_b', 'torque', 'moment_n', 'moment_b'),
                np.column_stack([value.s, value.positions, quaternions, value.strains,
                                 _inside(value)]).tolist())
    if isinstance(value, Plan):
        arms = [_rows_of(poses) for poses in value.arms.values()]
        return (('time', 'depth', *_PLACED, 'miss', 'misalignment', 'clearance', 'stability',
                 'residual', *(f'{name} {column}' for name in value.arms for column in _PLACED)),
                np.column_stack([value.times, value.depths, _rows_of(value.grippers),
                                 value.position_error, value.misalignment, value.clearance,
                                 value.stability, value.residual, *arms]).tolist())
    return ('quantity', 'value', 'unit'), rows_of(value)
