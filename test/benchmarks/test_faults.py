# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The list of faults is about the code as it is, and what notices a fault is told from what not."""

from collections import Counter

import pytest

from benchmarks import faults
from benchmarks.faults import ROOT, Fault


def test_each_fault_is_one_line_that_stands_once_in_its_file():
    known = faults.listed()
    assert len(known) >= 100
    assert [name for name, count in Counter(one.name for one in known).items() if count > 1] == []
    for one in known:
        text = (ROOT / one.file).read_text()
        assert one.old.strip('\n').count('\n') == 0
        assert one.applied(text).count('\n') == text.count('\n')
        for test in one.tests:
            file, _, name = test.partition('::')
            assert f'def {name}(' in (ROOT / file).read_text() if name else (ROOT / file).is_file()
        compile(one.applied(text), one.file, 'exec')


@pytest.mark.parametrize('text', ['a = 2\n', 'a = 1\nb = a = 1\n'])
def test_what_is_not_there_once_is_no_fault(text):
    with pytest.raises(ValueError, match='one: expected'):
        Fault('one', 'file.py', 'a = 1', 'a = 3', []).applied(text)


@pytest.mark.sweep
def test_a_fault_is_noticed_or_not_and_the_file_is_as_it_was(tmp_path):
    (tmp_path / 'halves.py').write_text('def half(x):\n    return x / 2\n')
    for name, x in (('well', 3), ('badly', 0)):
        (tmp_path / f'test_{name}.py').write_text(
            f'from halves import half\n\n\ndef test_it():\n    assert 2 * half({x}) == {x}\n')
    before = (tmp_path / 'halves.py').read_text()
    wrong = Fault('thirds', 'halves.py', 'x / 2', 'x / 3', ['test_well.py'])
    found = faults.tried(tmp_path, wrong)
    assert (found.said, found.by) == ('noticed', ['test_well.py::test_it'])
    assert faults.tried(tmp_path, wrong._replace(tests=['test_badly.py'])).said == 'unnoticed'
    assert faults.tried(tmp_path, wrong._replace(tests=['test_none.py'])).said == (
        'pytest ended with 4')
    slow = (tmp_path / 'test_well.py').read_text().replace(
        'def test_it', 'import pytest\n\n\n@pytest.mark.sweep\ndef test_it')
    (tmp_path / 'test_slow.py').write_text(slow)
    for options, said in (((), 'noticed'), (faults.QUICK, 'pytest ended with 5')):
        assert faults.tried(tmp_path, wrong._replace(tests=['test_slow.py']), *options).said == said
    assert (tmp_path / 'halves.py').read_text() == before
    assert faults.tested(tmp_path, found.by) == (0, [])
