# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The entry of the command `dlo-planner`: its subcommands, and with what status it ends."""

import re
import sys
import warnings
from collections.abc import Callable
from errno import EPIPE
from functools import partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast
from warnings import catch_warnings, simplefilter

try:
    import click
except ModuleNotFoundError:
    sys.exit('dlo-planner needs click: pip install click (Ubuntu: apt install python3-click)')

from dlo_planner.blas import one_thread_of_blas
from dlo_planner.errors import (
    DeadlineExceeded,
    DloPlannerError,
    DoubtfulInput,
    Infeasible,
    NotConverged,
)

FAULT, BAD_INPUT, NO_SOLUTION, INTERRUPTED = 1, 2, 3, 130  # exit codes
_LONGEST = 300  # characters of an error that nobody expected
_COMMANDS = {  # imported when they are called, so that --help is quick
    'cable': 'Describe a cable by its weight and its sag.',
    'shape': 'The shape of a DLO in a gripper.',
    'thread': 'Gripper poses that thread a DLO through cut-outs.',
    'plan': 'Gripper poses for any task, from a YAML file.',
    'replay': 'Prove a saved plan, at rest and in motion.',
    'identify': 'Find out what a DLO is like from points of it.',
    'map': 'Which cut-outs of a cell can be threaded.',
    'scene': 'What stands in a cell, from the file of it.',
    'doctor': 'Check the installation, and say what to do.'}


class Commands(click.Group):
    """The subcommands, imported when they are called; errors of the library end with a status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return their names, in the order of the work."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return one of them."""
        if name not in _COMMANDS:
            return None
        if name == 'doctor':  # it has to run where much is missing
            return cast(click.Command, import_module('dlo_planner.cli.doctor').doctor)
        return cast(click.Command, getattr(import_module('dlo_planner.cli.commands'),
                                           'map_cutouts' if name == 'map' else name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of them without importing any."""
        with formatter.section('Commands'):
            formatter.write_dl(list(_COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> object:
        """Run the command; say what was wrong in a line, without a traceback."""
        one_thread_of_blas()
        try:
            with catch_warnings():
                simplefilter('always', DoubtfulInput)
                warnings.showwarning = partial(_said, warnings.showwarning)
                return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except (Infeasible, NotConverged, DeadlineExceeded) as error:
            click.echo(f'no solution: {error}', err=True)
            if isinstance(error, Infeasible) and error.advice:  # a second or two of work
                click.echo(f'  {error.advice}', err=True)
            ctx.exit(NO_SOLUTION)
        except DloPlannerError as error:
            click.echo(f'Error: {error}', err=True)
            ctx.exit(BAD_INPUT)
        except KeyboardInterrupt:
            ctx.exit(INTERRUPTED)
        except Exception as error:  # whatever comes: a line for users, all of it for who mends it
            if ctx.params['traceback'] or getattr(error, 'errno', None) == EPIPE:  # click knows it
                raise
            if isinstance(error, OSError):
                click.echo(f'Error: {error}', err=True)
                ctx.exit(BAD_INPUT)
            said = ' '.join(f'{type(error).__name__}: {error}'.split())
            click.echo(f'Error: unexpected {said[:_LONGEST]}', err=True)
            click.echo('  a fault of dlo-planner: `dlo-planner --traceback ...` tells where',
                       err=True)
            ctx.exit(FAULT)


def _said(otherwise: Callable[..., object], message: Warning | str, category: type[Warning],
          *where: Any, **more: Any) -> None:
    """Show a warning of the package in a line; others as Python does."""
    if issubclass(category, DoubtfulInput):
        click.echo(f'warning: {message}', err=True)
    else:
        otherwise(message, category, *where, **more)


def _version() -> str:
    """Return the version: of the sources, where this is one of them; else as installed."""
    package = Path(__file__).parents[2] / 'package.xml'
    if package.is_file():
        match = re.search(r'<version>(.*?)</version>', package.read_text(encoding='utf-8'))
        return match[1] if match else ''
    return version('dlo_planner')


@click.group(cls=Commands, context_settings={'help_option_names': ['-h', '--help'],
                                             'max_content_width': 100})
@click.version_option(_version(), prog_name='dlo-planner')
@click.option('--traceback', is_flag=True, envvar='DLO_PLANNER_TRACEBACK',
              help='Show all of an unexpected error; also DLO_PLANNER_TRACEBACK=1.')
def main(traceback: bool) -> None:
    """Direct and inverse simulation of deformable linear objects (DLOs) in a gripper.

    A DLO (wire, hose, leaf spring) is described by a YAML file, the same as for the ROS node, or by
    the name of one that comes with the package: copper_wire, rubber_hose, steel_leaf_spring. SI
    units; a pose is X,Y,Z (level, along x), X,Y,Z,DX,DY,DZ (place and direction) or
    X,Y,Z,QX,QY,QZ,QW (place and quaternion).

    \b
    Examples:
      dlo-planner doctor
      dlo-planner shape copper_wire --gripper 0,0,1 -o wire.png
      dlo-planner thread copper_wire -p rod.diameter=0.0015 --hole 1,0.2,0.8,1,1,0 \\
          --radius 0.01 -o plan.npz -o plan.png -o gripper.poses.yaml
      dlo-planner replay copper_wire plan.npz -p rod.diameter=0.0015 -o report.png
      dlo-planner scene cell.xml
      dlo-planner COMMAND --help        more about a command, with examples

    \b
    Exit codes:
      0  done
      1  a fault of dlo-planner itself
      2  bad input: an option, a file or a value; the message names it
      3  no solution: infeasible, not converged, not safe, or the deadline is over
      130  interrupted
    """


if __name__ == '__main__':
    main()
