# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What subcommands have in common: types of arguments, options, the DLO that a file describes."""

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

import click

from dlo_planner.cli.reading import pose_of_numbers, read_obstacles
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError
from dlo_planner.settings.building import direct_of, doubts
from dlo_planner.settings.yaml_files import read_values
from dlo_planner.view.summaries import rod_line

_WIDTH = 30  # of a progress bar


class PoseType(click.ParamType):  # type: ignore[type-arg]  # generic in stubs alone
    """A Pose as 3, 6 or 7 numbers with commas between."""

    name = 'X,Y,Z[,...]'

    def convert(self, value: object, param: click.Parameter | None,
                ctx: click.Context | None) -> object:
        """Return the Pose."""
        try:
            name = param.name if param is not None else None
            return pose_of_numbers(name or 'pose', [float(one) for one in str(value).split(',')])
        except DloPlannerError as error:
            self.fail(str(error), param, ctx)
        except ValueError:
            self.fail(f'{value!r}: expected numbers with commas between: X,Y,Z, '
                      'X,Y,Z,DX,DY,DZ or X,Y,Z,QX,QY,QZ,QW', param, ctx)


class VectorType(click.ParamType):  # type: ignore[type-arg]  # generic in stubs alone
    """Numbers with commas between."""

    name = 'X,Y,Z'

    def convert(self, value: object, param: click.Parameter | None,
                ctx: click.Context | None) -> object:
        """Return them as a tuple of three."""
        try:
            numbers = tuple(float(one) for one in str(value).split(','))
        except ValueError:
            numbers = ()
        if len(numbers) != 3:
            self.fail(f'{value!r}: expected three numbers with commas between', param, ctx)
        return numbers


POSE, VECTOR = PoseType(), VectorType()
READ = click.Path(exists=True, dir_okay=False, path_type=Path)


def described(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the argument CONFIG and the options that say what the DLO and its surroundings are.

    What they describe, a Described, is the first argument of the command.
    """
    @wraps(command)
    def reading(config: str, changes: tuple[str, ...], obstacles: Path | None,
                **options: Any) -> object:
        return command(read_described(config, changes, obstacles), **options)

    for decorator in (
            click.option('--obstacles', type=READ, metavar='FILE',
                         help='YAML list of boxes, spheres, capsules and planes around the DLO.'),
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
    """What CONFIG and its options describe.

    Attributes
    ----------
    values : dict
        Values of all parameters.
    direct : DirectSimulator
    """

    values: dict[str, Any]
    direct: DirectSimulator

    @property
    def rod_line(self) -> str:
        """What the DLO is, in a line."""
        return rod_line(self.direct.rod, self.direct.gravity, self.values['rod.name'])


def read_described(config: str, changes: tuple[str, ...], obstacles: Path | None) -> Described:
    """Return what CONFIG and its options describe; warn of what has no effect or is doubtful."""
    values, warnings = read_values(config, changes)
    direct = direct_of(values, () if obstacles is None else read_obstacles(obstacles))
    for warning in warnings + doubts(direct.rod, direct.gravity):
        click.echo(f'warning: {warning}', err=True)
    return Described(values, direct)


class Bar:
    """A progress bar on standard error, where that is a terminal; give it as `progress=`.

    Parameters
    ----------
    label : str
        What is counted.
    """

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
            self._bar = click.progressbar(length=total, label=self._label, width=_WIDTH,
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
