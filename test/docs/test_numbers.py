# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of README and docs are those of the JSON that was measured."""

import re
from pathlib import Path

import pytest

from benchmarks.page import text
from benchmarks.said import places
from benchmarks.validation import page, pages, readme

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text()
WORDS = re.sub(r'```.*?```|\n {4}.*|\]\([^)]*\)|`[^`\n]*`', ' ', README, flags=re.S)  # no code


# what is no measurement: versions, sizes of what is shown, names
PLAIN = {'2', '3-D', 'Eq. 13', '3.11', '3.12', '3.13', '20', '1 m', '1 mm', '24.04', '2.0'}


def test_numbers_of_the_readme_are_those_that_were_measured():
    assert readme.updated(README) == README


def test_a_sentence_that_is_missing_is_named():
    with pytest.raises(ValueError, match='ms a shape'):
        readme.updated(README.replace('ms a shape', 'ms'))


def test_the_readme_has_no_other_numbers():
    rest = WORDS
    for said in readme.SAID:
        rest = re.sub(places(said), ' ', rest)
    for plain in sorted(PLAIN, key=len, reverse=True):
        rest = re.sub(rf'(?<![\w.]){re.escape(plain)}(?![\w])', ' ', rest)
    assert re.findall(r'(?<![\w.-])\d[\d.]*', rest) == []


@pytest.mark.parametrize('name', pages.SAID)
def test_numbers_in_sentences_of_pages_are_those_that_were_measured(name):
    assert pages.updated(name) == (pages.DOCS / name).read_text()


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
