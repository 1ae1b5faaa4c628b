# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of the documentation: its words are in page.md, its tables those that were measured."""

import re
from pathlib import Path

from benchmarks.report import data_of

_WORDS = Path(__file__).parent / 'page.md'
_PLACE = re.compile(r'\{\{(\w+)\}\}')


def text(words: str, folder: Path, inside: bool = False) -> str:
    """Return a page with each {{name}} replaced by name.md of a folder's data, if it is there.

    The page stands beside the folder, or inside it: that is where its pictures are linked from.
    """
    def table(found):
        path = data_of(folder) / f'{found[1]}.md'
        if not path.exists():
            return '*Not measured yet.*'
        told = path.read_text().split('\n', 2)[2].strip()  # without its title
        return told if inside else told.replace('](', f']({folder.name}/')

    return _PLACE.sub(table, words)


def write(folder: Path) -> None:
    """Write the page beside a folder of results, under the same name."""
    folder.with_suffix('.md').write_text(text(_WORDS.read_text(), folder))
