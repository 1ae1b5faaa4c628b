# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of a data set of others: numbers are read, code and what is no cable in meters is not."""

import codecs
import io
import pickle
import warnings

import numpy as np
import pytest

from benchmarks import deform
from benchmarks.deform_chain import save
from benchmarks.deform_files import load, recordings

pytestmark = pytest.mark.sweep  # the package has tests of its own


def hanging(frames=6, markers=12):
    """Return a cable (frames, markers, 3) that hangs between two grippers, m."""
    s = np.linspace(0, 1, markers)
    return np.tile(np.column_stack([s, 0.1 * s, 1 - s * (1 - s)]), (frames, 1, 1))


def packed(content, protocol=None):
    return io.BytesIO(pickle.dumps(content, protocol))


@pytest.mark.parametrize('content', [
    np.swapaxes(hanging(), 1, 2), list(np.swapaxes(hanging(), 1, 2)),
    np.swapaxes(hanging(), 1, 2).astype(np.float32),
    [tuple(map(tuple, frame.T)) for frame in hanging()],
    [[[np.float64(x) for x in row] for row in frame.T] for frame in hanging()]])
def test_arrays_lists_and_numbers_are_read(content):
    np.testing.assert_allclose(load(packed(content)), hanging(), rtol=1e-6)


def test_files_of_an_old_numpy_are_read():
    wanted = np.swapaxes(hanging(), 1, 2)
    for protocol in (2, 4):
        text = pickle.dumps(wanted, protocol)
        old = text.replace(b'numpy._core.multiarray', b'numpy.core.multiarray')
        if protocol == 4:  # its strings and its frame say how long they are
            fewer = len(text) - len(old)
            old = old.replace(b'\x8c\x16numpy.core', b'\x8c\x15numpy.core')
            old = old[:3] + (int.from_bytes(old[3:11], 'little') - fewer).to_bytes(
                8, 'little') + old[11:]
        assert b'numpy.core.multiarray' in old
        with warnings.catch_warnings():
            warnings.simplefilter('error')
            np.testing.assert_array_equal(load(io.BytesIO(old)), hanging())


class Calls:
    """Calls a function with an argument when it is read."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize(('function', 'name'), [
    (print, 'builtins.print'), (eval, 'builtins.eval'), (np.load, 'numpy'),
    (np.frombuffer, 'numpy'), (getattr, 'builtins.getattr')])
def test_code_is_not_run(function, name, capsys):
    with pytest.raises(pickle.UnpicklingError, match=f'numbers only, found {name}'):
        load(packed([Calls(function, 'print(7)')]))
    assert capsys.readouterr().out == ''


def test_bytes_are_read_as_arrays_have_them():
    with pytest.raises(pickle.UnpicklingError, match='latin1, found rot13'):
        load(packed([Calls(codecs.encode, 'abc', 'rot13')]))


def changed(kind):
    """Return a recording that is wrong in one way."""
    out = hanging()
    if kind == 'lost':
        out[3, 5, 1] = np.nan
    elif kind == 'endless':
        out[2, 7] = np.inf
    elif kind == 'twice':
        out[4, 8] = out[4, 9]
    elif kind == 'millimeters':
        out *= 1e3
    elif kind == 'rows':
        return out
    elif kind == 'few':
        out = out[:, ::3]
    return np.swapaxes(out, 1, 2)


@pytest.mark.parametrize(('kind', 'words'), [
    ('lost', 'marker 5 in frame 3'), ('endless', 'marker 7 in frame 2'),
    ('twice', 'markers 8 and 9 .* frame 4'), ('millimeters', 'expected meters'),
    ('rows', r'\(6, 12, 3\): expected \(frames, 3, markers\)'), ('few', '6 markers')])
def test_what_is_wrong_is_named_with_its_file(kind, words, tmp_path):
    save(tmp_path, 3, 'train', [hanging(), hanging()])
    path = tmp_path / 'data_set' / 'DLO3' / 'train' / '1.pkl'
    path.write_bytes(packed(changed(kind)).getvalue())
    with pytest.raises(ValueError, match=rf'1\.pkl: .*{words}'):
        recordings(tmp_path, 3, 'train')


@pytest.mark.parametrize('content', [
    b'', b'version https://git-lfs.github.com/spec/v1', b'\x80\x04N.', b'\x80\x04]',
    pickle.dumps({'a': 1}), pickle.dumps([[1.0], [1.0, 2.0]]), pickle.dumps(print)])
def test_other_files_are_named(content, tmp_path):
    save(tmp_path, 3, 'train', [hanging()])
    (tmp_path / 'data_set' / 'DLO3' / 'train' / '0.pkl').write_bytes(content)
    with pytest.raises(ValueError, match=r'0\.pkl: '):
        recordings(tmp_path, 3, 'train')


@pytest.mark.parametrize(('axes', 'side'), [([0, 2, 1], '-y'), ([2, 1, 0], '-x')])
def test_axes_that_are_swapped_are_named(axes, side, tmp_path):
    save(tmp_path, 3, 'train', [hanging()[..., axes]])
    with pytest.raises(ValueError, match=f'along {side}: expected z up'):
        recordings(tmp_path, 3, 'train')
    save(tmp_path, 3, 'eval', [hanging() * [1, 1, -1]])
    with pytest.raises(ValueError, match=r'along \+z: expected z up'):
        recordings(tmp_path, 3, 'eval')


def test_markers_and_frames_are_counted(tmp_path):
    save(tmp_path, 1, 'train', [hanging(), hanging(markers=13)])
    with pytest.raises(ValueError, match=r'1\.pkl: 13 markers: expected 12, as in 0\.pkl'):
        recordings(tmp_path, 1, 'train')
    save(tmp_path, 2, 'train', [hanging(90)])
    with pytest.raises(ValueError, match=r'0\.pkl: 90 frames: expected 100 or more'):
        deform.recorded(tmp_path, 2)
    save(tmp_path, 4, 'train', [hanging(100)])
    save(tmp_path, 4, 'eval', [hanging(502, 13)])
    with pytest.raises(ValueError, match='cable 4: 12 markers in train, 13 in eval'):
        deform.recorded(tmp_path, 4)
    save(tmp_path, 5, 'train', [hanging(100)])
    save(tmp_path, 5, 'eval', [hanging(501)])
    with pytest.raises(ValueError, match=r'eval.0\.pkl: 501 frames: expected 502'):
        deform.recorded(tmp_path, 5)


@pytest.mark.parametrize(('broken', 'words'), [
    (False, 'train: expected recordings'), (True, '0.pkl: from the first marker')])
def test_the_command_says_it_before_it_begins(broken, words, tmp_path, capsys):
    save(tmp_path, 1, 'train', [hanging(100)])
    save(tmp_path, 1, 'eval', [hanging(502)])
    if broken:
        save(tmp_path, 2, 'train', [hanging() * 1e3])
    with pytest.raises(SystemExit, match='2'):
        deform.main(['--data', str(tmp_path), '--cables', '1', '2'])
    told = capsys.readouterr().err
    assert words in told and 'DLO2' in told
    assert 'Traceback' not in told
