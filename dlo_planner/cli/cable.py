# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner cable`: a file of parameters from what a ruler and scales say of a cable."""

from pathlib import Path

import click
import numpy as np
from scipy.optimize import brentq

from dlo_planner.cli.outputs import checked
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.settings.building import doubts
from dlo_planner.settings.yaml_files import write_values
from dlo_planner.view.summaries import rod_line

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
    """Return EI in N m^2 of a rod, held level, whose free end hangs `sag` m below the gripper.

    Raises
    ------
    InvalidTask
        No stiffness gives that.
    """
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
