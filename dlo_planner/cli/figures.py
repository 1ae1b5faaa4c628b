# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner figures`: the scripts that make figures, listed and run."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import click

from dlo_planner.cli.main import NO_SOLUTION
from dlo_planner.errors import InvalidTask
from dlo_planner.view.summaries import text_table

_ROOT = Path(__file__).parents[2]
# Folders of the sources whose scripts make figures: each begins with a docstring that says what it
# shows, takes the folder to write to as its only argument, and ends with status 0.
FOLDERS = ('examples', 'benchmarks/figures')
_PAGES = {'view'}  # of these, those that open a page in the browser instead


def scripts(root: Path = _ROOT) -> dict[str, Path]:
    """Return the scripts that make figures, by name."""
    paths = [path for folder in FOLDERS for path in sorted((root / folder).glob('*.py'))]
    return {path.stem: path for path in paths
            if not path.stem.startswith('_') and path.stem not in _PAGES}


def shows(path: Path) -> str:
    """Return the first line of a script's docstring."""
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding='utf-8'))) or ''
    return docstring.split('\n', maxsplit=1)[0].rstrip('.')


@click.command('figures')
@click.argument('names', nargs=-1)
@click.option('--all', 'every', is_flag=True, help='Make all of them.')
@click.option('-o', '--output', 'folder', default='figures', show_default=True,
              type=click.Path(file_okay=False, path_type=Path), help='Folder that they go to.')
def command(names: tuple[str, ...], every: bool, folder: Path) -> None:
    """List the figures, or make those that are named.

    They are made by scripts of the repository, each of which can be read and run by itself.

    \b
    Examples:
      dlo-planner figures                       lists them
      dlo-planner figures dynamics plasticity -o pictures
      dlo-planner figures --all

    Exit code 3: a script failed.
    """
    known = scripts()
    if not known:
        raise InvalidTask(f'figures: expected the sources, whose folders {", ".join(FOLDERS)} hold '
                          'the scripts; this is an installed package')
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InvalidTask(f'figures: there is no {", ".join(unknown)}: expected '
                          f'{", ".join(known)}')
    chosen = list(known) if every else list(names)
    if not chosen:
        click.echo(text_table('figures', [(name, '', shows(path))
                                          for name, path in known.items()]))
        return
    folder.mkdir(parents=True, exist_ok=True)
    failed = [name for name in chosen if not _run(known[name], folder)]
    if failed:
        click.echo(f'failed: {", ".join(failed)}', err=True)
        raise SystemExit(NO_SOLUTION)


def _run(path: Path, folder: Path) -> bool:
    """Run a script; return whether it succeeded."""
    click.echo(f'{path.stem}: {shows(path)}')
    known = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get('PYTHONPATH')]))
    done = subprocess.run([sys.executable, str(path), str(folder)], check=False,
                          env=os.environ | {'MPLBACKEND': 'Agg', 'PYTHONPATH': known})
    return done.returncode == 0
