# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of README and of the page of validations are those of the JSON that was measured."""

import json
import re
from math import ceil
from pathlib import Path

import pytest

from benchmarks.page import text
from benchmarks.validation import page

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text()
WORDS = re.sub(r'```.*?```|\n {4}.*|\]\([^)]*\)|`[^`\n]*`', ' ', README, flags=re.S)  # no code


def measured(name, folder='validation'):
    return json.loads((ROOT / 'docs' / folder / f'{name}.json').read_text())


def milliseconds(*rows):
    core = measured('core', 'benchmarks')['core']
    return [f'{1e3 * core[row]["median_s"]:.1f}' for row in rows]


def farthest():
    """Return how far apart both engines are at most at rest, in contact; mm, rounded up."""
    rows = measured('cross_check')['cross_check'].values()
    return [f'{ceil(1e4 * max(row["apart_m"] for row in rows if row["kind"] == kind)) / 10:.1f}'
            for kind in ('static', 'contact')]


def validations():
    count = page.counts(page.load(ROOT / 'docs' / 'validation'))
    return [str(count[name]) for name in ('rows', 'scripts', 'tests')]


# each number of the README that was measured: how it is said there, and where it comes from
SAID = {
    r'About ([\d.]+) to ([\d.]+) ms a shape':
        lambda: milliseconds('warm solve, local', 'cold solve of B, local'),
    r'About ([\d.]+) ms a pose through one cut-out, ([\d.]+) ms through two':
        lambda: milliseconds('thread, a waypoint, local', 'thread_two, a waypoint'),
    r'(\d+) rows of figures by (\d+) scripts and (\d+) tests': validations,
    r'within ([\d.]+) mm of MuJoCo at rest, ([\d.]+) mm in contact': farthest,
}
# what is no measurement: versions, sizes of what is shown, names
PLAIN = {'2', '3-D', 'Eq. 13', '3.11', '3.12', '20', '1 m', '1 mm', '24.04', '2.0'}


@pytest.mark.parametrize('said', SAID)
def test_numbers_of_the_readme_are_measured(said):
    found = re.search(re.sub(' ', r'\\s+', said), WORDS)
    assert found, said
    assert list(found.groups()) == SAID[said]()


def test_the_readme_has_no_other_numbers():
    rest = WORDS
    for said in SAID:
        rest = re.sub(re.sub(' ', r'\\s+', said), ' ', rest)
    for plain in sorted(PLAIN, key=len, reverse=True):
        rest = re.sub(rf'(?<![\w.]){re.escape(plain)}(?![\w])', ' ', rest)
    assert re.findall(r'(?<![\w.-])\d[\d.]*', rest) == []


def test_the_page_of_validations_is_that_of_its_json():
    folder = ROOT / 'docs' / 'validation'
    known = page.load(folder)
    for name, table in page.tables(known).items():
        assert (folder / f'{name}.md').read_text() == f'# {name.capitalize()}\n\n{table}'
    words = (ROOT / 'benchmarks' / 'validation' / 'page.md').read_text()
    assert (ROOT / 'docs' / 'validation.md').read_text() == text(words, folder)


def test_every_figure_that_was_measured_once_says_when():
    lines = (ROOT / 'docs' / 'history.md').read_text().split('\n\n')
    blocks = [block for part in lines for block in re.split(r'\n(?=\* )', part)
              if re.search(r'\d', block) and not block.startswith(('#', '|', 'Runs that'))]
    assert len(blocks) > 20
    # what introduces a table or a list is dated below it
    assert [block[:60] for block in blocks if not block.rstrip().endswith(':')
            and not re.search(r'\*\(\d{4}-\d\d-\d\d, commit [0-9a-f]{7}\)\*', block)] == []
