# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner thread`: the inverse simulation."""

from collections.abc import Iterable
from pathlib import Path

import click

from dlo_planner.cli.arguments import POSE, Bar, Described, described, written
from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.cli.outputs import FILMS, PICTURES, POSES, VALUES, checked, write
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.settings.building import inverse_of, limits_of, tolerance_of
from dlo_planner.settings.threading import Present, Wanted, way_through
from dlo_planner.verify.replay import replay

_ENDINGS = (*PICTURES, *FILMS, *VALUES, '.csv', *POSES)


@click.command('thread')
@described
@click.option('--hole', 'holes', type=POSE, multiple=True, required=True,
              help='Pose of a cut-out: its center and the direction in which the free end goes '
              'through. May be repeated: passed one after the other.')
@click.option('--radius', type=float, help='Of the holes, m, for clearances.')
@click.option('--start', type=POSE, help='Pose of the gripper now. With the parameter '
              'threading.standoff above 0, or -1, the plan begins there.')
@click.option('--prove', is_flag=True, help='Replay the plan, at rest and in motion, and report.')
@click.option('--deadline', type=float, help='Seconds of computing. Default: the parameter '
              'threading.planning_deadline.')
@written('.png .svg .pdf the picture, .gif .mp4 the film, .npz .json the plan (Plan.load and '
         '"dlo-planner replay" read it), .csv its waypoints, .poses.yaml .poses.json '
         'geometry_msgs/Pose[] of the gripper')
def command(dlo: Described, holes: tuple[Pose, ...], radius: float | None, start: Pose | None,
            prove: bool, deadline: float | None, outputs: tuple[Path, ...]) -> None:
    """Plan the gripper poses that thread the free end through cut-outs.

    CONFIG is a YAML file of parameters, as for the node, or copper_wire, rubber_hose,
    steel_leaf_spring. Its parameters threading.* and workspace.* count.

    \b
    Examples:
      dlo-planner thread copper_wire -p rod.diameter=0.0015 --hole 1,0.2,0.8,1,1,0 --radius 0.01
      dlo-planner thread rubber_hose --hole 0,0,1 -o plan.npz -o plan.png -o plan.gif
      dlo-planner thread rubber_hose --hole 0,0,1 -o gripper.poses.json      for MoveIt
      dlo-planner thread rubber_hose --hole 0,0,1 --start -0.8,0,1 -p threading.standoff=-1 \\
          --prove

    Exit code 3: there is no such plan (the reason is said, with the waypoint, the constraint and
    the amount), or with --prove it is not safe.
    """
    checked(outputs, _ENDINGS)
    values, direct = dlo
    inverse = inverse_of(values, direct)
    cutouts = [CutOut(pose, radius=radius or values['cutouts.radius'] or None) for pose in holes]
    with Bar('waypoints') as bar:
        plan = way_through(inverse, cutouts, Wanted.of(values), Present(start), progress=bar,
                           deadline=deadline or values['threading.planning_deadline'])
    click.echo(plan.summary())
    write(plan, outputs, obstacles=direct.obstacles)
    if prove:
        raise SystemExit(proved(dlo, plan))


def proved(dlo: Described, plan: Plan, outputs: Iterable[Path] = ()) -> int:
    """Replay a Plan, say and write the ValidationReport; return the exit code."""
    values, direct = dlo
    with Bar('steps') as bar:
        report = replay(direct, plan, obstacles=direct.obstacles, limits=limits_of(values),
                        tolerance=tolerance_of(values), progress=bar,
                        workspace=inverse_of(values, direct).workspace,
                        deadline=values['threading.deadline'])
    click.echo(report.summary())
    write(report, outputs)
    return 0 if report.safe else NO_SOLUTION
