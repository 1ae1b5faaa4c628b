# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner thread`, `plan` and `replay`: the inverse simulation, and the proof of its plans."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from dlo_planner.cli.arguments import POSE, READ, Bar, Described, described, written
from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.cli.outputs import FILMS, PICTURES, POSES, VALUES, checked, write
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.settings.building import inverse_of, limits_of, tolerance_of
from dlo_planner.settings.tasks import read_task
from dlo_planner.settings.threading import Present, Wanted, way_through
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.replay import replay as replayed
from dlo_planner.verify.report import ValidationReport

_ENDINGS = (*PICTURES, *FILMS, *VALUES, '.csv', *POSES)


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
            click.option('--start', type=POSE, help='Pose of the gripper now.')):
        command = decorator(command)
    return command


@click.command('thread')
@described
@click.option('--hole', 'holes', type=POSE, multiple=True, required=True,
              help='Pose of a cut-out: its center and the direction in which the free end goes '
              'through. May be repeated: passed one after the other.')
@click.option('--radius', type=float, help='Of the holes, m, for clearances.')
@planning
def thread(dlo: Described, holes: tuple[Pose, ...], radius: float | None, start: Pose | None,
           deadline: float | None, **options: Any) -> None:
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

    Exit code 3: there is no such plan (the reason is said, with the waypoint, the constraint and
    the amount), or with --prove it is not safe.
    """
    checked(options['outputs'], _ENDINGS)
    values = dlo.values
    cutouts = [CutOut(pose, radius=radius or values['cutouts.radius'] or None) for pose in holes]
    with Bar('waypoints') as bar:
        plan = way_through(inverse_of(values, dlo.direct), cutouts, Wanted.of(values),
                           Present(start), progress=bar,
                           deadline=deadline or values['threading.planning_deadline'])
    _finish(dlo, plan, **options)


@click.command('plan')
@described
@click.argument('task', type=READ)
@planning
def plan(dlo: Described, task: Path, start: Pose | None, deadline: float | None,
         **options: Any) -> None:
    """Plan the gripper poses for any task: insert, hold or slide a contact, pass several cut-outs.

    CONFIG describes the DLO, as for "dlo-planner thread". TASK is a YAML file: the class of the
    task under `type`, its arguments beside, each value in it likewise (Task.to_dict writes it).

    \b
    Examples:
      dlo-planner plan rubber_hose insert.yaml --prove -o plan.npz -o motion.csv

    \b
    insert.yaml:
      type: Insert
      bore: {type: CutOut, pose: {position: [0.4, 0, 1]}, radius: 0.012}
      depths: [0, 0.02, 0.04, 0.06]

    Exit code 3: there is no such plan, or with --prove it is not safe.
    """
    checked(options['outputs'], _ENDINGS)
    asked = read_task(task)
    inverse = inverse_of(dlo.values, dlo.direct)
    with Bar('waypoints') as bar:
        found = inverse.plan(asked, start=start, progress=bar, requirements=replace(
            inverse.requirements, limits=limits_of(dlo.values),
            deadline=deadline or dlo.values['threading.planning_deadline']))
    _finish(dlo, found, **options)


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
    report = _proved(dlo, Plan.load(plan))
    write(report, outputs)
    if not report.safe:
        raise SystemExit(NO_SOLUTION)


def _finish(dlo: Described, found: Plan, prove: bool, outputs: Iterable[Path]) -> None:
    """Say a Plan, prove it if that was asked for, and write it, or the motion that was proved."""
    click.echo(found.summary())
    if not prove:
        write(found, outputs, obstacles=dlo.direct.obstacles)
        return
    report = _proved(dlo, found)
    if not report.safe or report.trajectory is None:
        click.echo('nothing was written: the motion is not safe', err=True)
        raise SystemExit(NO_SOLUTION)
    for path in outputs:
        if path.suffix.lower() == '.npz':
            write(found, [path])
        elif path.suffix.lower() in PICTURES + FILMS:
            write(_retimed(found, report.trajectory), [path], obstacles=dlo.direct.obstacles)
        else:
            write(report.trajectory, [path], rate=dlo.values['execute.rate'])


def _proved(dlo: Described, found: Plan) -> ValidationReport:
    """Replay a Plan and say the ValidationReport."""
    values, direct = dlo.values, dlo.direct
    with Bar('steps') as bar:
        report = replayed(direct, found, obstacles=direct.obstacles, limits=limits_of(values),
                          tolerance=tolerance_of(values), progress=bar,
                          workspace=inverse_of(values, direct).workspace,
                          deadline=values['threading.deadline'])
    click.echo(report.summary())
    return report


def _retimed(found: Plan, trajectory: Trajectory) -> Plan:
    """Return a Plan with the times at which a Trajectory of it comes by its waypoints."""
    times = np.linspace(0.0, trajectory.duration, max(1000, 20 * len(found)))
    return replace(found, times=np.interp(found.times, trajectory.progress(times), times))
