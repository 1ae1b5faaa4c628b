# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner shape`: the direct simulation."""

from pathlib import Path

import click

from dlo_planner.cli.arguments import POSE, READ, Bar, Described, described, written
from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.cli.outputs import PICTURES, POSES, VALUES, checked, write
from dlo_planner.cli.reading import read_poses
from dlo_planner.errors import InvalidTask
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd

_ENDINGS = (*PICTURES, *VALUES, '.csv', *POSES)


@click.command('shape')
@described
@click.option('-g', '--gripper', 'grippers', type=POSE, multiple=True,
              help='Pose of the gripper; may be repeated: the DLO follows from one to the next.')
@click.option('--grippers', 'file', type=READ, metavar='FILE',
              help='The same poses from a YAML or JSON file.')
@click.option('--far-end', type=POSE, help='Pose at which the other end is held too.')
@click.option('--grip', type=click.Choice(['clamped', 'pinned', 'sleeve', 'aligned']),
              default='clamped', show_default=True, help='How the far end is held.')
@written('.png .svg .pdf the picture, .npz .json the shape (Shape.load reads it), .csv its nodes, '
         '.poses.yaml .poses.json geometry_msgs/Pose[] of its nodes')
def command(dlo: Described, grippers: tuple[Pose, ...], file: Path | None, far_end: Pose | None,
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
      dlo-planner shape copper_wire -g 0,0,1 -g 0,0,0.8 --obstacles table.yaml -o on_table.png

    \b
    table.yaml:
      - box: {pose: [0.5, 0, 0.3], size: [1.0, 1.0, 0.6], friction: 0.3}
      - sphere: {center: [0.4, 0, 0.7], radius: 0.05}

    Exit code 3: the shape did not converge (it is written all the same, and says so).
    """
    checked(outputs, _ENDINGS)
    poses = [*grippers, *([] if file is None else read_poses(Path(file)))]
    if not poses:
        raise InvalidTask('--gripper: expected at least one pose')
    direct = dlo.direct
    if far_end is not None:
        if len(poses) > 1:
            raise InvalidTask('--far-end: expected one --gripper with it')
        shape = direct.solve(poses[0], far_end=FarEnd(far_end, grip))
    else:
        with Bar('poses') as bar:
            shape = direct.track(poses, bar)[-1]
    click.echo(shape.summary())
    write(shape, outputs)
    if not shape.converged:
        raise SystemExit(NO_SOLUTION)
