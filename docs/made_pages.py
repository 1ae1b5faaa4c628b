# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A Sphinx extension: pages made of files that stand elsewhere in the repository.

Tutorials are scripts (`examples/tutorials/*.py`), which the tests run. Comments after `# %%` become
text, the rest code. The gallery shows the picture of each other example beside its script. The
parameters of the node come from the table that declares them. CONTRIBUTING and the changelog are
copied, so that the folder of the site is complete in itself, as rosdoc2 needs it.
"""

import ast
import re
from pathlib import Path

from dlo_planner.settings.parameters import PARAMETERS, ParameterSpec

COPIES = ('CONTRIBUTING.md', 'CHANGELOG.rst')
TUTORIALS = {  # page -> scripts
    'predict_and_identify': ('predict', 'identify'), 'thread': ('thread', 'two_holes'),
    'contact': ('contact',), 'calm_motion_and_closed_loop': ('calm_motion', 'closed_loop'),
    'own_loop': ('own_loop',), 'cell_in_ros': ('cell_in_ros',),
    'own_task_and_penalty': ('own_task', 'own_penalty'), 'many_tasks': ('many_tasks',)}


def cells(script: str) -> list[tuple[str, str]]:
    """Return the cells of a script: pairs of text (Markdown) and code."""
    found = []
    for part in re.split(r'^# %%.*\n', script, flags=re.MULTILINE)[1:]:
        lines = part.splitlines()
        n_text = next((n for n, line in enumerate(lines) if not line.startswith('#')), len(lines))
        text = '\n'.join(line[2:] for line in lines[:n_text])
        found.append((text, '\n'.join(lines[n_text:]).strip('\n')))
    return found


def tutorial_page(paths: list[Path]) -> str:
    """Return tutorials as one page of Markdown; the first cell of each begins with its title."""
    parts = []
    for path in paths:
        for text, code in cells(path.read_text()):
            parts += [text] * bool(text) + [f'```python\n{code}\n```'] * bool(code)
        parts.append(f'*The script `examples/tutorials/{path.name}`; the tests run it.*')
    return '\n\n'.join(parts) + '\n'


def gallery(root: Path) -> str:
    """Return a page with all examples that have a picture: what it shows, and the script."""
    parts = ['# Gallery', 'Each script draws its picture: `python examples/obstacles.py FOLDER`.']
    for path in sorted((root / 'examples').glob('*.py')):
        if not (root / 'docs' / 'pictures' / f'{path.stem}.png').exists():
            continue
        text = path.read_text()
        title = ast.get_docstring(ast.parse(text)).splitlines()[0]
        parts += [f'## {path.stem.replace("_", " ").capitalize()}', title,
                  f'![{title}](../pictures/{path.stem}.png)',
                  f'<details><summary>examples/{path.name}</summary>',
                  f'```python\n{text}```', '</details>']
    return '\n\n'.join(parts) + '\n'


def parameters_page() -> str:
    """Return a page with all parameters, from the table that the node declares them by."""
    parts = ['# Parameters', 'All parameters of the node, of the YAML files and of '
             '`dlo-planner -p`, as `ros2 param describe` prints them. This page is made from the '
             'table in `dlo_planner/settings/parameters.py`.']
    groups: dict[str, list[str]] = {}
    for name, entry in PARAMETERS.items():
        group = name.split('.')[0] if '.' in name else 'Of the node itself'
        groups.setdefault(group, []).append(parameter_row(name, entry))
    for group, rows in groups.items():
        parts += [f'## {group}', '| name | default | limits | meaning |\n|---|---|---|---|\n'
                  + '\n'.join(rows)]
    return '\n\n'.join(parts) + '\n'


def parameter_row(name: str, entry: ParameterSpec) -> str:
    """Return the row of one parameter."""
    limits = '' if entry.lowest is None else f'{entry.lowest:g} to {entry.highest:g}'
    fixed = not (entry.read_only or entry.while_executing)
    text = (entry.description.replace(' |', ',') + ' *Read only.*' * entry.read_only
            + ' *Not while a plan is executed.*' * fixed)
    return f'| `{name}` | `{entry.default!r}` | {limits} | {text} |'


def copied(path: Path) -> str:
    """Return a file of the repository's root with its links as they are from the site."""
    return re.sub(r'\]\(docs/', '](../', path.read_text())


def make(app) -> None:
    """Write the pages into the folder `made` of the site's sources."""
    root = Path(__file__).resolve().parent.parent
    folder = Path(app.srcdir) / 'made'
    folder.mkdir(exist_ok=True)
    scripts = root / 'examples' / 'tutorials'
    pages = {f'{page}.md': tutorial_page([scripts / f'{name}.py' for name in names])
             for page, names in TUTORIALS.items()}
    pages |= {name: copied(root / name) for name in COPIES if (root / name).exists()}
    pages |= {'gallery.md': gallery(root), 'parameters.md': parameters_page()}
    for old in folder.iterdir():
        if old.name not in pages:
            old.unlink()
    for name, text in pages.items():
        page = folder / name
        if not page.exists() or page.read_text() != text:
            page.write_text(text)


def setup(app) -> dict:
    """Make the pages before Sphinx looks for them."""
    app.connect('config-inited', lambda app, _: make(app))
    return {'parallel_read_safe': True}
