# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner identify`: a DLO's properties from points of it."""

from pathlib import Path

import click

from dlo_planner.cli.arguments import POSE, READ, Bar, Described, described
from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.cli.outputs import checked, write_table
from dlo_planner.cli.reading import read_observations
from dlo_planner.identify.fitting import fit_rod
from dlo_planner.model.pose import Pose
from dlo_planner.settings.identified import NAMES, identified
from dlo_planner.settings.yaml_files import write_values
from dlo_planner.view.answers import fit_rows

_DEFAULT = ('bending_stiffness', 'natural_curvature')


@click.command('identify')
@described
@click.argument('observations', type=READ, nargs=-1, required=True)
@click.option('-g', '--gripper', 'grippers', type=POSE, multiple=True,
              help='Pose of the gripper for a CSV file of points; once for each of them.')
@click.option('--find', 'names', multiple=True, default=_DEFAULT, show_default=True,
              type=click.Choice(NAMES), help='What is sought; may be repeated.')
@click.option('--noise', type=float, help='Standard deviation of each coordinate of a point, m. '
              'Default: from the misfit.')
@click.option('-o', '--output', 'outputs', multiple=True, metavar='FILE',
              type=click.Path(dir_okay=False, path_type=Path),
              help='Write a file; may be repeated: .yaml all parameters, for the node and as '
              'CONFIG; .csv what was found.')
def command(dlo: Described, observations: tuple[Path, ...], grippers: tuple[Pose, ...],
            names: tuple[str, ...], noise: float | None, outputs: tuple[Path, ...]) -> None:
    """Find out what a DLO is like: it hangs from the gripper, points of it were seen.

    CONFIG is a first guess, and right in all that is not sought. OBSERVATIONS are YAML files, or
    CSV files of points x, y, z (m, world) with --gripper for each. Two or more poses of the gripper
    tell more. Shapes tell ratios: stiffness is found beside a mass that is known.

    \b
    Examples:
      dlo-planner identify my_cable.yaml seen.csv --gripper 0,0,1 -o identified.yaml
      dlo-planner identify my_cable.yaml looks.yaml --find bending_stiffness
      dlo-planner shape identified.yaml --gripper 0,0,1 -o wire.png

    \b
    looks.yaml:
      - gripper: {position: [0, 0, 1], orientation: [0, 0, 0, 1]}
        points: [[0.2, 0.0, 0.98], [0.5, 0.0, 0.86], [0.8, 0.0, 0.61]]
        s: [0.2, 0.52, 0.9]     # arc lengths in m, where they are known

    Exit code 3: the search did not come to its end.
    """
    checked(outputs, ('.yaml', '.csv'))
    values, direct = dlo
    observed = read_observations(observations, grippers)
    with Bar('searches') as bar:
        fit = fit_rod(direct.rod, observed, names, noise=noise, progress=bar,
                      gravity=direct.gravity, obstacles=direct.obstacles)
    click.echo(fit.summary())
    for path in outputs:
        if path.suffix.lower() == '.csv':
            write_table(path, ('quantity', 'value', 'deviation or unit'), fit_rows(fit))
        else:
            write_values(path, values | identified(fit, values))
        click.echo(f'wrote {path}')
    if not fit.converged:
        raise SystemExit(NO_SOLUTION)
