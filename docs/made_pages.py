# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A Sphinx extension: pages made of files that stand elsewhere in the repository.

Tutorials are scripts (`examples/tutorials/*.py`), which the tests run. Comments after `# %%` become
text, the rest code. The gallery shows the picture of each other example beside its script. The
layers come from the import rules in `pyproject.toml`, the parameters of the node from the table
that declares them. CONTRIBUTING, the changelog and the
declaration of quality are copied, so that the folder of the site is complete in itself, as rosdoc2
needs it.
"""

import ast
import re
import tomllib
from pathlib import Path

from dlo_planner.settings.entries import ENTRIES, Entry

COPIES = ('CONTRIBUTING.md', 'CHANGELOG.rst', 'QUALITY_DECLARATION.md')


def cells(script: str) -> list[tuple[str, str]]:
    """Return the cells of a script: pairs of text (Markdown) and code."""
    found = []
    for part in re.split(r'^# %%.*\n', script, flags=re.MULTILINE)[1:]:
        lines = part.splitlines()
        n_text = next((n for n, line in enumerate(lines) if not line.startswith('#')), len(lines))
        text = '\n'.join(line[2:] for line in lines[:n_text])
        found.append((text, '\n'.join(lines[n_text:]).strip('\n')))
    return found


def tutorial_page(path: Path) -> str:
    """Return a tutorial as Markdown; its first cell begins with the title."""
    parts = []
    for text, code in cells(path.read_text()):
        parts += [text] * bool(text) + [f'```python\n{code}\n```'] * bool(code)
    return '\n\n'.join([*parts, f'*This page is the script `examples/tutorials/{path.name}`. '
                                'The tests run it.*']) + '\n'


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


def layers_page(root: Path) -> str:
    """Return a page with the layers, drawn from the rules that hold them."""
    rules = tomllib.loads((root / 'pyproject.toml').read_text())['tool']['importlinter']
    rows = [[name.strip().removeprefix('dlo_planner.') for name in row.split('|')]
            for row in rules['contracts'][0]['layers']]
    others = '\n'.join(f'* {contract["name"]}' for contract in rules['contracts'][1:])
    return ('# Layers\n\nA package may import what stands below it, and nothing else. '
            'The picture is drawn from the\nrules in `pyproject.toml`, which a test holds.\n\n'
            '```{raw} html\n'
            f'{layers_drawing(rows)}\n```\n\nAlso:\n\n{others}\n\nWhat each package is for: '
            f'[CONTRIBUTING](CONTRIBUTING.md).\n')


def layers_drawing(rows: list[list[str]]) -> str:
    """Return rows of names as an SVG of boxes."""
    width, height, gap = 720, 34, 6
    boxes = []
    for k, row in enumerate(rows):
        each = (width - gap * (len(row) - 1)) / len(row)
        for j, name in enumerate(row):
            x, y = j * (each + gap), k * (height + gap)
            boxes.append(f'<rect x="{x:.0f}" y="{y}" width="{each:.0f}" height="{height}" rx="5" '
                         'fill="none" stroke="currentColor"/>'
                         f'<text x="{x + each / 2:.0f}" y="{y + height * 0.64:.0f}" '
                         f'text-anchor="middle" fill="currentColor" font-size="14">{name}</text>')
    total = len(rows) * (height + gap)
    return (f'<svg viewBox="-1 -1 {width + 2} {total + 2}" role="img" '
            f'aria-label="layers of the package">{"".join(boxes)}</svg>')


def parameters_page() -> str:
    """Return a page with all parameters, from the table that the node declares them by."""
    parts = ['# Parameters', 'All parameters of the node, of the YAML files and of '
             '`dlo-planner -p`, as `ros2 param describe` prints them. This page is made from the '
             'table in `dlo_planner/settings/entries.py`.']
    groups: dict[str, list[str]] = {}
    for name, entry in ENTRIES.items():
        group = name.split('.')[0] if '.' in name else 'Of the node itself'
        groups.setdefault(group, []).append(parameter_row(name, entry))
    for group, rows in groups.items():
        parts += [f'## {group}', '| name | default | limits | meaning |\n|---|---|---|---|\n'
                  + '\n'.join(rows)]
    return '\n\n'.join(parts) + '\n'


def parameter_row(name: str, entry: Entry) -> str:
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
    pages = {path.with_suffix('.md').name: tutorial_page(path)
             for path in sorted((root / 'examples' / 'tutorials').glob('[a-z]*.py'))}
    pages |= {name: copied(root / name) for name in COPIES if (root / name).exists()}
    pages |= {'gallery.md': gallery(root), 'layers.md': layers_page(root),
              'parameters.md': parameters_page()}
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
