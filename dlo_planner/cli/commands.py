# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The subcommands: shape, thread, plan, replay, cable, identify, map."""

from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.optimize import brentq

from dlo_planner.cli.io import (
    FILMS,
    PICTURES,
    POSE,
    POSES,
    READ,
    SCENE_OPTIONS,
    SCENES,
    VALUES,
    VECTOR,
    Bar,
    Described,
    checked,
    described,
    joints_of,
    read_poses,
    read_scene,
    write,
    write_table,
    written,
)
from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.fit import fit_rod
from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.thread_sequence import threading_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, doubts
from dlo_planner.model.triangles import UNITS
from dlo_planner.parallel import CapabilityMap, CellGrid, capability_map
from dlo_planner.parallel.capability import QUANTITIES
from dlo_planner.plan.plan import Plan
from dlo_planner.settings.build import (
    NAMES,
    inverse_of,
    limits_of,
    parameters_of_fit,
    refuse_grasped,
    tolerance_of,
)
from dlo_planner.settings.looks import Photograph, read_observations
from dlo_planner.settings.tasks import plan_task, read_task
from dlo_planner.settings.yaml_files import write_values
from dlo_planner.signals import leave_to_parent
from dlo_planner.verify.replay import replay as replayed
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.summary import rod_line, rows_of

_PLAN_ENDINGS = (*PICTURES, *VALUES, '.csv', *POSES, *FILMS)
_SHAPE_ENDINGS = (*PICTURES, *VALUES, '.csv', *POSES, *SCENES)
_MAP_ENDINGS = (*PICTURES, '.csv')


@click.command('shape')
@described
@click.option('-g', '--gripper', 'grippers', **POSE, multiple=True,
              help='Pose of the gripper; may be repeated: the DLO follows from one to the next.')
@click.option('--grippers', 'file', type=READ, metavar='FILE',
              help='The same poses from a YAML or JSON file.')
@click.option('--far-end', **POSE, help='Pose at which the other end is held too.')
@click.option('--grip', type=click.Choice(['clamped', 'pinned', 'sleeve', 'aligned']),
              default='clamped', show_default=True, help='How the far end is held.')
@written('.png .svg .pdf the picture, .npz .json the shape (Shape.load reads it), .csv its nodes, '
         '.poses.yaml .poses.json geometry_msgs/Pose[] of its nodes, .scene .xml the DLO as '
         'capsules for MoveIt or MuJoCo')
def shape(dlo: Described, grippers: tuple[Pose, ...], file: Path | None, far_end: Pose | None,
          grip: str, outputs: tuple[Path, ...]) -> None:
    """Predict the shape of a DLO for a pose of its gripper.

    CONFIG is a YAML file of parameters, as for the node, or copper_wire, rubber_hose,
    steel_leaf_spring. With several poses the DLO follows slowly from one to the next, and the last
    shape counts.

    \b
    Examples:
      dlo-planner shape copper_wire --gripper 0,0,1
      dlo-planner shape rubber_hose -g 0,0,1,1,0,-1 -o hose.png -o hose.csv
      dlo-planner shape my_cable.yaml -g 0,0,1 --far-end 0.6,0,1 --grip clamped -o held.npz
      dlo-planner shape copper_wire -g 0,0,1 -g 0,0,0.8 --scene table.yaml -o on_table.png
      dlo-planner shape copper_wire -g 0,0,1 --scene cell.xml -o wire.scene

    \b
    table.yaml:
      - box: {name: table, pose: [0.5, 0, 0.3], size: [1.0, 1.0, 0.6], friction: 0.3}
      - sphere: {center: [0.4, 0, 0.7], radius: 0.05}
      - file: {path: fixture.stl, unit: mm, pose: [0.4, 0.2, 0.6]}

    Exit code 3: the shape did not converge (it is written all the same, and says so).
    """
    checked(outputs, _SHAPE_ENDINGS)
    poses = [*grippers, *([] if file is None else read_poses(Path(file)))]
    if not poses:
        raise InvalidTask('--gripper: expected at least one pose')
    if far_end is not None:
        refuse_grasped(dlo.values, '--far-end')
        if len(poses) > 1:
            raise InvalidTask('--far-end: expected one --gripper with it')
        shape = dlo.direct.solve(poses[0], far_end=FarEnd(far_end, grip))
    else:
        with Bar('poses') as bar:
            shape = dlo.held.track(poses, bar)[-1]
    click.echo(shape.summary())
    write(shape, outputs)
    if not shape.converged:
        raise SystemExit(NO_SOLUTION)


@click.command('scene')
@click.argument('files', type=READ, nargs=-1, required=True)
@SCENE_OPTIONS[3]
@SCENE_OPTIONS[2]
@SCENE_OPTIONS[1]
@SCENE_OPTIONS[0]
@click.option('--friction', type=float, default=0.0, show_default=True,
              help='Of obstacles that state none.')
@written('.png .svg .pdf the picture, .scene MoveIt, .xml MJCF, .yaml obstacles by their fields, '
         'for --scene and scene.file')
def scene(files: tuple[Path, ...], joints: tuple[str, ...], scene_at: Pose | None,
          scene_unit: str | None, hulls: bool, friction: float,
          outputs: tuple[Path, ...]) -> None:
    """Read files of a cell, and list what stands in it: obstacles and cut-outs, in m.

    FILES are MoveIt scenes (.scene), MJCF (.xml), URDF (.urdf), triangles (.stl .obj .ply .glb
    .3mf) or YAML lists, what other commands take for --scene. A cut-out is listed as --hole takes
    it. A plate with round or rectangular holes is known as such from its triangles, too.

    \b
    Examples:
      dlo-planner scene cell.scene -o cell.png
      dlo-planner scene fixture.stl --scene-unit mm --scene-at 0.4,0,1 -o fixture.yaml
      dlo-planner scene gripper.urdf --joint finger_joint=0.02 -o gripper.scene
    """
    checked(outputs, (*PICTURES, *SCENES, '.yaml'))
    found = read_scene(files, scene_unit, scene_at, joints_of(joints), friction, hulls=hulls,
                       counted=False)
    click.echo(replace(found, notes=()).summary())
    for path in outputs:
        if path.suffix.lower() in PICTURES:
            found.plot().savefig(path, dpi=_DPI)
        else:
            found.write(path)
        click.echo(f'wrote {path}')


def planning(command: Any) -> Any:
    """Add the options of commands that plan."""
    for decorator in (
            written('.npz .json the plan ("dlo-planner replay" and Plan.load read it), .png .svg '
                    '.pdf the picture, .gif .mp4 the film, .csv its waypoints, .poses.yaml '
                    '.poses.json geometry_msgs/Pose[] of the gripper; with --prove .json .csv '
                    '.poses.* are the motion, execute.rate poses a second'),
            click.option('--deadline', type=float, help='Seconds of computing. Default: the '
                         'parameter threading.planning_deadline.'),
            click.option('--prove', is_flag=True, help='Replay the plan, at rest and in motion, '
                         'and report; what is written is the motion that was proved, and nothing '
                         'where it is not safe.'),
            click.option('--start', **POSE, help='Pose of the gripper now.')):
        command = decorator(command)
    return command


@click.command('thread')
@described
@click.option('--hole', 'holes', multiple=True, required=True, metavar='X,Y,Z[,...]|NAME',
              help='Pose of a cut-out: its center and the direction in which the free end goes '
              'through; or its name in the scene, as "dlo-planner scene" lists it, NAME:back from '
              'behind. May be repeated: passed one after the other.')
@click.option('--radius', type=float, help='Of the holes that are poses, m, for clearances.')
@click.option('--max-misalignment', type=float, help='Largest angle against the normal at which '
              'the DLO passes, rad; 0: along the normal. Of one hole, with a radius. Default: the '
              'parameter threading.max_misalignment.')
@click.option('--margin', type=float, help='Least margin in the holes, m: the clearance less two '
              'standard deviations of the expected miss. With a radius. Default: the parameter '
              'threading.margin.')
@click.option('--hold-at', type=float, help='Where the gripper holds the DLO, m from its '
              'beginning: what is in front of it is threaded. Default: the parameter '
              'rod.grasped_at.')
@planning
def thread(dlo: Described, holes: tuple[str, ...], radius: float | None,
           max_misalignment: float | None, margin: float | None, hold_at: float | None,
           start: Pose | None, deadline: float | None, **options: Any) -> None:
    """Plan the gripper poses that thread the free end through cut-outs.

    CONFIG is a YAML file of parameters, as for the node, or copper_wire, rubber_hose,
    steel_leaf_spring. Its parameters threading.* and workspace.* count. With --start and the
    parameter threading.standoff above 0, or -1, the plan begins at the gripper's pose.

    \b
    Examples:
      dlo-planner thread copper_wire -p rod.diameter=0.0015 --hole 1,0.2,0.8,1,1,0 --radius 0.01
      dlo-planner thread rubber_hose --hole 0,0,1 --radius 0.012 --prove -o plan.npz -o motion.csv
      dlo-planner thread rubber_hose --hole 0,0,1 -o plan.gif -o gripper.poses.json    for MoveIt
      dlo-planner thread rubber_hose --hole 0,0,1 --start -0.8,0,1 -p threading.standoff=-1 \\
          --prove
      dlo-planner thread rubber_hose --hole 0,0,1 --hold-at 0.4
      dlo-planner thread rubber_hose --scene panel.stl --hole panel/0 --prove

    Exit code 3: there is no such plan (the reason is said, with the waypoint, the constraint and
    the amount), or with --prove it is not safe.
    """
    checked(options['outputs'], _PLAN_ENDINGS)
    if radius is not None:
        radius = number('--radius', radius, above=0, unit='m')
    else:
        radius = dlo.values['cutouts.radius'] or None  # 0: not known
    given = {'rod.grasped_at': hold_at, 'threading.max_misalignment': max_misalignment,
             'threading.margin': margin}
    if hold_at is not None:
        number('--hold-at', hold_at, minimum=0, below=dlo.direct.rod.length, unit='m')
    if max_misalignment is not None:
        number('--max-misalignment', max_misalignment, minimum=0, maximum=np.pi / 2, unit='rad')
        if len(holes) > 1:
            raise InvalidTask('--max-misalignment: expected one --hole with it')
    if margin is not None:
        number('--margin', margin, above=0, unit='m')
        if radius is None:
            raise InvalidTask('--margin: expected --radius with it, the size of the holes')
    dlo = dlo._replace(values={**dlo.values, **{
        name: value for name, value in given.items() if value is not None}})
    dlo, cutouts = _holes(dlo, holes, radius)
    _finish(dlo, _planned(dlo, threading_of(cutouts), start, deadline), **options)


def _holes(dlo: Described, holes: Iterable[str],
           radius: float | None) -> tuple[Described, list[CutOut]]:
    """Return the cut-outs that are meant, and the cell in which they lead the way they are to."""
    scene, cutouts = dlo.scene, []
    for text in holes:
        name, back, _ = text.partition(':back')
        if name not in scene.cutout_names and ',' in text:
            cutouts.append(CutOut(POSE['type'](text), radius=radius))
            continue
        if back:
            scene = scene.turned(name)
        try:
            cutouts.append(scene.cutout(name))
        except InvalidTask as error:  # by the name of the option
            raise InvalidTask(str(error).replace('name =', '--hole =', 1)) from None
    if scene is not dlo.scene:
        dlo = dlo._replace(scene=scene, direct=dlo.direct.with_obstacles(scene.obstacles))
    return dlo, cutouts


@click.command('plan')
@described
@click.argument('task', type=READ)
@planning
def plan(dlo: Described, task: Path, start: Pose | None, deadline: float | None,
         **options: Any) -> None:
    """Plan the gripper poses for any task: insert, hold or slide a contact, pass several cut-outs.

    CONFIG describes the DLO, as for "dlo-planner thread". TASK is a YAML file: the class of the
    task under `type`, its arguments beside, each value in it likewise (Task.to_dict writes it).
    Depths that it leaves out are those of the parameters threading.*, as for the node.

    \b
    Examples:
      dlo-planner plan rubber_hose insert.yaml --prove -o plan.npz -o motion.csv

    \b
    insert.yaml:
      type: Insert
      bore: {pose: {position: [0.4, 0, 1]}, radius: 0.012}
      depths: [0, 0.02, 0.04, 0.06]

    Exit code 3: there is no such plan, or with --prove it is not safe.
    """
    checked(options['outputs'], _PLAN_ENDINGS)
    read = read_task(task, dlo.values['cutouts.radius'] or None)  # 0: not known
    _finish(dlo, _planned(dlo, read, start, deadline), **options)


@click.command('replay')
@described
@click.argument('plan', type=READ)
@written('.png .svg .pdf the picture, .npz .json the report (ValidationReport.load reads it), '
         '.csv its figures')
def replay(dlo: Described, plan: Path, outputs: tuple[Path, ...]) -> None:
    """Run a saved plan through the direct simulator: slowly, and in motion as it is executed.

    CONFIG describes the DLO, as for "dlo-planner thread": the planner's own, or a better known one.
    PLAN is a file that "dlo-planner thread -o plan.npz" or Plan.save wrote. The parameters
    threading.* say the limits of the motion, and by how much it may miss (threading.tolerance).

    \b
    Examples:
      dlo-planner replay rubber_hose plan.npz
      dlo-planner replay rubber_hose plan.npz -p rod.youngs_modulus=7e6 -o report.png -o report.csv

    Exit code 3: the plan must not be executed; the reason is in the table.
    """
    checked(outputs, (*PICTURES, *VALUES, '.csv'))
    click.echo(dlo.rod_line)
    found = Plan.load(plan)
    if found.events:
        if outputs:
            raise InvalidTask(f'-o {outputs[0]}: expected none for a plan with {len(found.stages)} '
                              'stages, each has a report')
        reports = [*_stages_proved(dlo, found).values()]
    else:
        reports = [_proved(dlo, found)]
        write(reports[0], outputs)
    if not all(report.safe for report in reports):
        raise SystemExit(NO_SOLUTION)


def _planned(dlo: Described, task: Task, start: Pose | None, deadline: float | None) -> Plan:
    """Return the Plan of a task, as the node makes it."""
    values = dlo.values
    with Bar('waypoints') as bar:
        return plan_task(inverse_of(values, dlo.direct), task, values, start=start, progress=bar,
                         deadline=values['threading.planning_deadline'] if deadline is None
                         else number('--deadline', deadline, above=0, unit='s'))


def _finish(dlo: Described, found: Plan, prove: bool, outputs: Iterable[Path]) -> None:
    """Say a Plan, prove it if that was asked for, and write it, or the motion that was proved."""
    click.echo(found.summary())
    if np.isfinite(found.margin).any() and np.nanmin(found.margin) < 0.0:
        click.echo('note: margin is the clearance less two deviations of what is uncertain '
                   '(spread.* in CONFIG): below 0 the DLO may touch, if it is not as stated. '
                   'One that was identified is less uncertain; --margin refuses plans with less',
                   err=True)
    if not prove:
        write(found, outputs, obstacles=dlo.direct.obstacles)
        return
    if found.events:
        _finish_stages(dlo, found, outputs)
        return
    report = _proved(dlo, found)
    if not report.safe or report.trajectory is None:
        click.echo('nothing was written: the motion is not safe', err=True)
        raise SystemExit(NO_SOLUTION)
    for path in outputs:
        if path.suffix.lower() == '.npz':
            write(found, [path])
        elif path.suffix.lower() in PICTURES + FILMS:
            # at the times at which the trajectory comes by the waypoints
            times = np.linspace(0.0, report.trajectory.duration, max(1000, 20 * len(found)))
            timed = replace(found, times=np.interp(
                found.times, report.trajectory.progress(times), times))
            write(timed, [path], obstacles=dlo.direct.obstacles)
        else:
            write(report.trajectory, [path], rate=dlo.values['execute.rate'])


def _finish_stages(dlo: Described, found: Plan, outputs: Iterable[Path]) -> None:
    """Prove a Plan whose stages are held differently, and write it, and the motion of each."""
    reports = _stages_proved(dlo, found)
    if not all(report.safe for report in reports.values()):
        click.echo('nothing was written: the motion is not safe', err=True)
        raise SystemExit(NO_SOLUTION)
    for path in outputs:
        if path.suffix.lower() in ('.npz', *PICTURES, *FILMS):
            write(found, [path], obstacles=dlo.direct.obstacles)
            continue
        for k, report in reports.items():
            assert report.trajectory is not None  # it is safe
            write(report.trajectory, [path.with_stem(f'{path.stem}_{k + 1}')],
                  rate=dlo.values['execute.rate'])


def _stages_proved(dlo: Described, found: Plan) -> dict[int, ValidationReport]:
    """Replay each stage of a Plan that moves, say it, and return the reports by their indices."""
    reports = dict[int, ValidationReport]()
    for k, stage in enumerate(found.stage_plans):
        for event in (one for one in found.events if one.stage == k):
            click.echo(f'{event}')
        click.echo(f'{found.stages[k].name}:')
        if stage.arms:
            reports[k] = _proved(dlo, stage, stage.shapes[0])
            if not reports[k].safe:
                break
    return reports


def _proved(dlo: Described, found: Plan, initial: Shape | None = None) -> ValidationReport:
    """Replay a Plan and say the ValidationReport."""
    values, direct = dlo.values, dlo.direct
    with Bar('steps') as bar:
        report = replayed(direct, found, obstacles=direct.obstacles, limits=limits_of(values),
                          tolerance=tolerance_of(values), progress=bar, initial=initial,
                          workspace=inverse_of(values, direct).workspace,
                          deadline=values['threading.deadline'])
    click.echo(report.summary())
    return report


_GRAVITY = 9.81
_STIFFEST, _LIMPEST = 1e-2, 1e4   # w L^3 / EI that is looked for
_READING = 1e-3                   # m, how exactly a sag is read
_ACCURACY = 1e-5                  # of the length
_POSE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@click.command('cable')
@click.option('--diameter', type=float, required=True, help='Outer diameter, m.')
@click.option('--mass-per-length', 'mass', type=float, required=True, help='kg/m.')
@click.option('--length', type=float, required=True,
              help='Length that hangs out of the gripper, m.')
@click.option('--sag', type=float, required=True, help='How far its free end hangs below the '
              'gripper that holds it level, m.')
@click.option('--torsion', type=float, default=0.75, show_default=True,
              help='GJ / EI, which a sag does not show: 1 / (1 + Poisson ratio) of a solid round '
              'section, less of strands.')
@click.option('--name', default='cable', show_default=True, help='Name of it, for the log.')
@click.option('-o', '--output', type=click.Path(dir_okay=False, path_type=Path), required=True,
              help='YAML file: CONFIG of the other commands, and for the node.')
def cable(diameter: float, mass: float, length: float, sag: float, torsion: float, name: str,
          output: Path) -> None:
    """Describe a cable by its weight and by how far it hangs down.

    Hold it level at one end, straightened, and measure how far the other end hangs below. Its
    bending stiffness follows; GJ is a part of it that is assumed. "dlo-planner identify" finds
    more, from points of the cable.

    \b
    Examples:
      dlo-planner cable --diameter 0.006 --mass-per-length 0.045 --length 0.5 --sag 0.12 \\
          -o my_cable.yaml
      dlo-planner shape my_cable.yaml --gripper 0,0,1 -o my_cable.png
    """
    checked([output], ['.yaml'])
    stiffness = stiffness_of_sag(diameter, mass, length, sag)
    rod = _rod(diameter, mass, length, stiffness, torsion)
    for doubt in doubts(rod):
        click.echo(f'warning: {doubt}', err=True)
    click.echo(rod_line(rod, name=name))
    nearby = [stiffness_of_sag(diameter, mass, length, one) for one in (
        sag - min(_READING, 0.1 * sag), sag + min(_READING, 0.1 * (length - sag)))]
    click.echo(f'EI {stiffness:.4g} N m^2 by its sag; {max(nearby):.4g} to {min(nearby):.4g} if '
               f'that is off by 1 mm')
    click.echo(f'GJ {torsion * stiffness:.4g} N m^2 is assumed: {torsion:g} EI')
    write_values(output, {
        'rod.name': name, 'rod.section': 'stiffness', 'rod.length': length,
        'rod.diameter': diameter, 'rod.mass_per_length': mass,
        'rod.bending_stiffness': [stiffness] * 2, 'rod.torsional_stiffness': torsion * stiffness})
    click.echo(f'wrote {output}')


def stiffness_of_sag(diameter: float, mass: float, length: float, sag: float) -> float:
    """Return EI in N m^2 of a rod, held level, whose free end hangs `sag` m below the gripper."""
    _rod(diameter, mass, length, 1.0, 1.0)  # judges them
    if mass == 0:
        raise InvalidTask('--mass-per-length = 0: expected more than 0, its weight bends it')
    scale = mass * _GRAVITY * length**3

    def excess(log_limpness: float) -> float:
        rod = _rod(diameter, mass, length, scale / np.exp(log_limpness), 1.0)
        shape = DirectSimulator(rod, accuracy=_ACCURACY * length).solve(_POSE)
        return float(-shape.positions[-1, 2] - sag)

    ends = np.log([_STIFFEST, _LIMPEST])
    least, most = (excess(end) + sag for end in ends)
    if not least <= sag <= most:
        raise InvalidTask(f'--sag = {sag:g}: expected {least:.3g} to {most:.3g} m of a cable of '
                          f'{length:g} m; more says that it is limp, less that it is too stiff to '
                          'be measured so')
    return float(scale / np.exp(brentq(excess, *ends, xtol=1e-7)))


def _rod(diameter: float, mass: float, length: float, stiffness: float, torsion: float) -> Rod:
    return Rod(length, mass, stiffness, torsion * stiffness, radius=diameter / 2)


_SOUGHT = ('bending_stiffness', 'natural_curvature')


def _photograph(text: str) -> Photograph:
    """Return what U,V,SIZE says of the pixels of a photograph."""
    try:
        u, v, size = map(float, text.split(','))
    except ValueError:
        raise click.BadParameter(f'{text!r}: expected U,V,SIZE, as 412,96,0.00058') from None
    if not (np.isfinite([u, v]).all() and 0.0 < size < _LARGEST_PIXEL):
        raise click.BadParameter(f'{text!r}: expected two pixels, and a size above 0 and below '
                                 f'{_LARGEST_PIXEL:g} m')
    return Photograph(u, v, size)


_LARGEST_PIXEL = 0.1  # m: a DLO that is seen by larger ones is seen by a dozen at most


@click.command('identify')
@described
@click.argument('observations', type=READ, nargs=-1, required=True)
@click.option('-g', '--gripper', 'grippers', **POSE, multiple=True,
              help='Pose of the gripper for a table of points; once for each of them.')
@click.option('--unit', type=click.Choice(list(UNITS)), default='m', show_default=True,
              help='Of lengths in tables whose heading states none.')
@click.option('--pixels', 'photographs', type=_photograph, metavar='U,V,SIZE', multiple=True,
              help='What the columns u and v of a photograph mean: the pixel at which the gripper '
              'is, from the left and from the top, and how many m a pixel is; once for all of '
              'them, or for each.')
@click.option('--find', 'names', multiple=True, default=_SOUGHT, show_default=True,
              type=click.Choice(NAMES), help='What is sought; may be repeated.')
@click.option('--noise', type=float, help='Standard deviation of each coordinate of a point, m; '
              'the misfit is held against it. Default: from the misfit.')
@click.option('-o', '--output', 'outputs', multiple=True, metavar='FILE',
              type=click.Path(dir_okay=False, path_type=Path),
              help='Write a file; may be repeated: .yaml all parameters, for the node and as '
              'CONFIG; .csv what was found; .png .svg .pdf a picture of it beside the points.')
def identify(dlo: Described, observations: tuple[Path, ...], grippers: tuple[Pose, ...],
            unit: str, photographs: tuple[Photograph, ...], names: tuple[str, ...],
            noise: float | None, outputs: tuple[Path, ...]) -> None:
    """Find out what a DLO is like: it hangs from the gripper, points of it were seen.

    CONFIG is a first guess, and right in all that is not sought. OBSERVATIONS are YAML files, or
    tables of points (.csv, .tsv, .npy; world) with --gripper for each. Columns are told by the
    heading: x, y, z, and s where arc lengths are known, as "x" or "x [mm]", in any order among
    others; without a heading they are x, y, z. Semicolons allow a decimal comma. A picture has two
    of x, y, z: the third is not measured; or its pixels u, v (to the right, down), with --pixels.
    Two or more poses of the gripper tell more. Shapes tell ratios: stiffness is found beside a mass
    that is known.

    \b
    Examples:
      dlo-planner identify my_cable.yaml seen.csv --gripper 0,0,1 -o identified.yaml
      dlo-planner identify my_cable.yaml photo.csv --gripper 0,0,1 --pixels 412,96,0.00058
      dlo-planner identify my_cable.yaml looks.yaml --find bending_stiffness
      dlo-planner shape identified.yaml --gripper 0,0,1 -o wire.png

    \b
    looks.yaml:
      - gripper: {position: [0, 0, 1], orientation: [0, 0, 0, 1]}
        points: [[0.2, 0.0, 0.98], [0.5, 0.0, 0.86], [0.8, 0.0, 0.61]]
        s: [0.2, 0.52, 0.9]     # arc lengths in m, where they are known
        far_end: {pose: [0.9, 0, 0.6], grip: clamped}   # where it is held
        normal: [0, 1, 0]       # of a picture: along which nothing is measured
        unit: m                 # of points and s: m, cm, mm, in
        initial: before.npz     # a Shape next to that which was seen, where there are several

    Exit code 3: the search did not come to its end, or no such DLO has these points: swapped axes,
    another unit or frame. Parameters (-o x.yaml) are not written then.
    """
    checked(outputs, ('.yaml', '.csv', *PICTURES))
    values, direct = dlo.values, dlo.direct
    refuse_grasped(values, 'identify')
    observed = read_observations(observations, grippers, unit, photographs)
    with Bar('searches') as bar:
        fit = fit_rod(direct.rod, observed, names, noise=noise, progress=bar,
                      gravity=direct.gravity, obstacles=direct.obstacles)
    click.echo(fit.summary())
    if fit.doubt:
        click.echo(f'{fit.status}: {fit.doubt}', err=True)
    for path in outputs:
        if path.suffix.lower() == '.csv':
            write_table(path, ('quantity', 'value', 'deviation or unit'), rows_of(fit))
        elif path.suffix.lower() in PICTURES:
            fit.plot().savefig(path, dpi=_DPI)
        elif not fit.converged:  # nobody is to work with it
            click.echo(f'not written: {path}', err=True)
            continue
        else:
            write_values(path, values | parameters_of_fit(fit, values))
        click.echo(f'wrote {path}')
    if not fit.converged:
        raise SystemExit(NO_SOLUTION)


_DPI = 130


def _evenly(text: str) -> Floats:
    """Return evenly spaced numbers: one, or FIRST:LAST:COUNT."""
    parts = text.split(':')
    try:
        if len(parts) == 1:
            return np.array([float(text)])
        first, last, count = parts
        return np.linspace(float(first), float(last), click.IntRange(1)(count))
    except (ValueError, click.BadParameter) as error:
        raise click.BadParameter(f'{text!r}: expected a number in m, or FIRST:LAST:COUNT; '
                                 f'{error}') from None


_RANGE: dict[str, Any] = {'type': _evenly, 'metavar': 'FIRST:LAST:COUNT'}


@click.command('map')
@described
@click.option('--x', **_RANGE, required=True, help='Of the centers of the holes, m.')
@click.option('--y', **_RANGE, default='0', show_default=True)
@click.option('--z', **_RANGE, required=True)
@click.option('--along', 'directions', **VECTOR, multiple=True, default=['1,0,0'],
              show_default=True, help='In which the free end goes through; may be repeated.')
@click.option('--radius', 'radii', type=float, multiple=True, required=True,
              help='Of the holes, m; may be repeated.')
@click.option('--start', 'starts', **POSE, multiple=True,
              help='Pose of the gripper from which the way there is looked for too.')
@click.option('--jobs', type=click.IntRange(1, 1024), default=1, show_default=True,
              help='Processes that work at once.')
@click.option('--folder', type=click.Path(file_okay=False, path_type=Path),
              help='Where parts are kept: an interrupted map goes on from there.')
@click.option('--axis', type=click.Choice(['x', 'y', 'z']), default='y', show_default=True,
              help='Across which the slices of the picture lie.')
@click.option('--quantity', type=click.Choice(list(QUANTITIES)), default='share',
              show_default=True, help='What the picture shows.')
@written('.png .svg .pdf slices of the map, .csv a line for each cut-out')
def map_cutouts(dlo: Described, outputs: tuple[Path, ...], jobs: int, axis: str, quantity: str,
                **ranges: Any) -> None:
    """Find out which round cut-outs of a cell can be threaded, with what margin.

    CONFIG describes the DLO and the gripper's workspace (parameters workspace.*). Each combination
    of place, direction and radius is one cut-out.

    \b
    Examples:
      dlo-planner map rubber_hose --x 0.2:1:5 --z 0.6:1.4:5 --radius 0.02 --jobs 4 -o map.png \\
          -p 'workspace.lower=[-0.2, -0.3, 0.5]' -p 'workspace.upper=[0.6, 0.3, 1.2]'
      dlo-planner map rubber_hose --x 0.5 --z 1 --along 1,0,0 --along 1,0,-1 --radius 0.012 \\
          --radius 0.02 -o map.csv

    Exit code 3: none of them can be threaded.
    """
    checked(outputs, _MAP_ENDINGS)
    values, direct = dlo.values, dlo.direct
    refuse_grasped(values, 'map')
    places = np.stack(np.meshgrid(ranges['x'], ranges['y'], ranges['z'], indexing='ij'), axis=-1)
    grid = CellGrid(places.reshape(-1, 3), ranges['directions'], ranges['radii'])
    workers = None if jobs == 1 else partial(ProcessPoolExecutor, jobs,
                                             mp_context=get_context('forkserver'),
                                             initializer=leave_to_parent)
    depths = np.linspace(0.0, values['threading.deepest'] * direct.rod.length,
                         values['threading.waypoints'])
    with Bar('cut-outs') as bar:
        capability = capability_map(inverse_of(values, direct), grid, workers, depths=depths,
                                    starts=ranges['starts'], folder=ranges['folder'], progress=bar,
                                    chunk=max(1, min(32, len(grid) // (4 * jobs))))
    click.echo(dlo.rod_line)
    click.echo(capability.summary())
    for path in outputs:
        if path.suffix.lower() == '.csv':
            write_table(path, _HEAD, _rows(capability))
        else:
            capability.plot(axis=axis, quantity=quantity).savefig(path, dpi=_DPI)
        click.echo(f'wrote {path}')
    if not capability.threaded.any():
        raise SystemExit(NO_SOLUTION)


_HEAD = (*'xyz', 'direction_x', 'direction_y', 'direction_z', 'radius', 'outcome', 'amount',
         'fraction', 'clearance', 'stability', 'roll', 'start')


def _rows(capability: CapabilityMap) -> Iterator[list[object]]:
    """Yield a row for each cut-out."""
    grid = capability.grid
    for place in np.ndindex(grid.shape):
        p, d, r = place
        yield [*grid.positions[p], *grid.directions[d], grid.radii[r],
               *(getattr(capability, name)[place] for name in _HEAD[7:])]
