# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the docs are those of the JSON that was measured."""

import re
from pathlib import Path

import pytest

from benchmarks.report import data_of
from benchmarks.validation import page, pages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize('name', pages.SAID)
def test_numbers_in_sentences_of_pages_are_those_that_were_measured(name):
    assert pages.updated(name) == (pages.DOCS / name).read_text()


def test_the_pages_of_validations_are_those_of_their_json():
    folder = ROOT / 'docs' / 'validation'
    tables = page.tables(page.load(folder))
    for name, table in tables.items():
        assert (data_of(folder) / f'{name}.md').read_text() == f'# {name.capitalize()}\n\n{table}'
    pages_now = page.pages_of(folder)
    assert {path for path in pages_now if path.parent == folder} == {*folder.glob('*.md')}
    for path, words in pages_now.items():
        assert path.read_text() == words
    placed = re.findall(r'\{\{(\w+)\}\}', ''.join(
        path.read_text() for path in page.WORDS.glob('*.md')))
    assert len(placed) == len(set(placed)) and {*tables} < {*placed}  # each on one page


def test_every_figure_that_was_measured_once_says_when():
    lines = (ROOT / 'benchmarks' / 'results' / 'history.md').read_text().split('\n\n')
    blocks = [block for part in lines for block in re.split(r'\n(?=\* )', part)
              if re.search(r'\d', block) and not block.startswith(('#', '|', 'Runs that'))]
    assert len(blocks) > 20
    # what introduces a table or a list is dated below it
    assert [block[:60] for block in blocks if not block.rstrip().endswith(':')
            and not re.search(r'\*\(\d{4}-\d\d-\d\d, commit [0-9a-f]{7}\)\*', block)] == []
