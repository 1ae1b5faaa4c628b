# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner map`: which cut-outs of a cell can be threaded."""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import click
import numpy as np

from dlo_planner.cli.arguments import POSE, VECTOR, Bar, Described, described, written
from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.cli.outputs import PICTURES, checked, write_table
from dlo_planner.model.arrays import Floats
from dlo_planner.parallel import CapabilityMap, CellGrid, capability_map
from dlo_planner.parallel.capability import QUANTITIES
from dlo_planner.settings.building import inverse_of

_ENDINGS = (*PICTURES, '.csv')
_DPI = 130


class RangeType(click.ParamType):  # type: ignore[type-arg]  # generic in stubs alone
    """Evenly spaced numbers: one, or FIRST:LAST:COUNT."""

    name = 'FIRST:LAST:COUNT'

    def convert(self, value: object, param: click.Parameter | None,
                ctx: click.Context | None) -> Floats:
        """Return them as an array."""
        parts = str(value).split(':')
        try:
            if len(parts) == 1:
                return np.array([float(parts[0])])
            first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
            if len(parts) == 3 and count > 0:
                return np.linspace(first, last, count)
        except (ValueError, IndexError):
            pass
        self.fail(f'{value!r}: expected a number in m, or FIRST:LAST:COUNT', param, ctx)


_RANGE = RangeType()


@click.command('map')
@described
@click.option('--x', type=_RANGE, required=True, help='Of the centers of the holes, m.')
@click.option('--y', type=_RANGE, default='0', show_default=True)
@click.option('--z', type=_RANGE, required=True)
@click.option('--along', 'directions', type=VECTOR, multiple=True, default=['1,0,0'],
              show_default=True, help='In which the free end goes through; may be repeated.')
@click.option('--radius', 'radii', type=float, multiple=True, required=True,
              help='Of the holes, m; may be repeated.')
@click.option('--start', 'starts', type=POSE, multiple=True,
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
def command(dlo: Described, outputs: tuple[Path, ...], jobs: int, axis: str, quantity: str,
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
    checked(outputs, _ENDINGS)
    values, direct = dlo
    places = np.stack(np.meshgrid(ranges['x'], ranges['y'], ranges['z'], indexing='ij'), axis=-1)
    grid = CellGrid(places.reshape(-1, 3), ranges['directions'], ranges['radii'])
    workers = None if jobs == 1 else partial(ProcessPoolExecutor, jobs,
                                             mp_context=get_context('forkserver'))
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
