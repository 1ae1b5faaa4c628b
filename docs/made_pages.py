"""A Sphinx extension: pages made of files that stand elsewhere in the repository.

Tutorials are scripts (`examples/tutorials/*.py`), which the tests run. Comments after `# %%` become
text, the rest code. CONTRIBUTING, the changelog and the declaration of quality are copied, so that
the folder of the site is complete in itself, as rosdoc2 needs it.
"""

import re
from pathlib import Path

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
