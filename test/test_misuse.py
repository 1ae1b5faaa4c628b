# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whatever is given for an argument: an answer, or an error that says what is wrong with it."""

import shutil

import matplotlib
import pytest
from matplotlib import pyplot
from misuse import MALFORMED, arguments_of, outcome, public_callables
from specimens import CORNERS, SIDES, arguments, values

PARTS = 4
CALLABLES = {name: (function, kind) for name, function, kind in public_callables()}


def example(callable_name, argument):
    known = arguments()
    name = f'{callable_name}.{argument}'
    return known[name if name in known else argument]


def keywords_of(name, parameters):
    """Return good arguments, those with defaults where there is an example."""
    known, keywords = arguments(), {}
    for argument, parameter in parameters.items():
        if argument in known or f'{name}.{argument}' in known:
            keywords[argument] = example(name, argument)
        else:
            assert parameter.default is not parameter.empty, (
                f'{name}: no example of the argument {argument!r} in test/specimens.py')
    return keywords


@pytest.fixture(scope='module')
def saved(tmp_path_factory):
    """Return a folder with a file of each value that can be saved."""
    folder = tmp_path_factory.mktemp('saved')
    for name, file in (('Shape', 'saved'), ('Plan', 'plan'), ('Motion', 'motion'),
                       ('ValidationReport', 'report'), ('Trajectory', 'trajectory')):
        values()[name].save(folder / f'{file}.npz')
    for name in ('Fit', 'Robustness', 'Shapes'):
        values()[name].save(folder / f'{name}.json')
    (folder / 'tetrahedron.obj').write_text(''.join(
        [f'v {x} {y} {z}\n' for x, y, z in CORNERS]
        + [f'f {a + 1} {b + 1} {c + 1}\n' for a, b, c in SIDES]))
    return folder


@pytest.fixture(autouse=True)
def somewhere(saved, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some malformed names of files are good ones
    shutil.copytree(saved, tmp_path, dirs_exist_ok=True)
    monkeypatch.setitem(matplotlib.rcParams, 'figure.max_open_warning', 0)
    yield
    pyplot.close('all')


@pytest.mark.every(PARTS + 1)  # one part of the values for most callables
@pytest.mark.parametrize('part', range(PARTS))
@pytest.mark.parametrize('name', CALLABLES)
def test_malformed_arguments_are_refused_by_name(name, part):
    function, kind = CALLABLES[name]
    parameters = arguments_of(function, kind)
    if kind is not None:
        owner = values()[name if name in values() else kind.__name__]
        function = getattr(owner, function.__name__)
    good, wrong = keywords_of(name, parameters), []
    function(**good)  # or what follows would be no test
    for argument in parameters:
        for label, make in [*MALFORMED.items()][part::PARTS]:
            what = outcome(function, good | {argument: make()}, argument, (argument,))
            if what:
                wrong.append(f'{name}({argument}={label}) {what}')
    assert not wrong, '\n'.join([f'{len(wrong)} are wrong:', *wrong])
