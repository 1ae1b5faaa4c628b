# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Real cables: reading recordings, what holds the cable in them, and its prediction.

The data set itself is not here; another engine makes recordings in its layout.
"""

import codecs
import io
import pickle
import shutil
import warnings

import numpy as np
import pytest

from benchmarks import deform, deform_doubt, deform_surrogate
from benchmarks.deform import load, recordings
from benchmarks.deform_chain import by_chain, save
from benchmarks.deform_data import DT, Recording, arc_lengths, smoothed
from benchmarks.deform_doubt import doubted
from dlo_planner import DirectSimulator, Rod

pytestmark = pytest.mark.sweep  # the package has tests of its own

LENGTH, MASS, DRAG, MARKERS = 0.9, 0.03, 0.8, 12
STIFFNESS = MASS * 9.81 * LENGTH**3 / 60


@pytest.fixture(scope='module')
def recorded():
    return by_chain(10, 152, LENGTH, MASS, STIFFNESS, DRAG, MARKERS)[0]


def _cable(softness=60.0, damping=DRAG, length=LENGTH):
    """Return a Cable: as recorded, with another weight and the same ratio to its stiffness."""
    stiffness = 0.02 * 9.81 * length**3 / softness
    rod = Rod(length, 0.02, stiffness, 0.75 * stiffness, damping=(damping, 0.0))
    return deform.Cable(rod, np.linspace(0, length, MARKERS - 2), None, deform.Effort(), 0.0)


def test_what_was_saved_is_read(tmp_path, recorded):
    save(tmp_path, 2, 'train', [recorded, recorded + 1])
    found = recordings(tmp_path, 2, 'train')
    assert [one.name for one in found] == ['0', '1']
    np.testing.assert_array_equal(found[1].markers, recorded + 1)
    with pytest.raises(FileNotFoundError, match='DLO2'):
        recordings(tmp_path, 2, 'eval')


def test_arc_lengths_of_a_circle():
    angles = np.linspace(0, 2.5, 10)
    circle = 0.3 * np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    first, last = circle[0] - [0.02, 0, 0], circle[-1] + 0.02 * np.array(
        [np.cos(2.5), 0, -np.sin(2.5)])
    markers = np.tile(np.concatenate([[first], circle, [last]]), (60, 1, 1))
    np.testing.assert_allclose(arc_lengths([Recording('', markers)]), 0.3 * angles, atol=1e-4)


def test_what_holds_the_cable(recorded):
    one = Recording('', recorded)
    grippers, ends = one.held(LENGTH)
    assert len(grippers) == len(ends) == len(recorded) + 50
    steps = np.linalg.norm(np.diff([pose.position for pose in grippers], axis=0), axis=1)
    assert steps[0] < 0.01 * steps[50]  # it begins at rest and gathers speed
    assert np.abs(np.diff(steps)).max() < 0.3 * steps.max()
    for k in (0, 60, -1):
        held = recorded[k]
        pose, end = grippers[k if k < 0 else 50 + k], ends[k if k < 0 else 50 + k]
        np.testing.assert_allclose(pose.position, held[1], atol=3e-4)
        along = held[1] - held[0]
        np.testing.assert_allclose(pose.direction, along / np.linalg.norm(along), atol=0.02)
        np.testing.assert_allclose(end.pose.position, held[-2], atol=3e-4)
        assert end.grip == 'aligned'
    near, far = one.held(0.5)  # too short: the far end is brought nearer
    away = [np.linalg.norm(end.pose.position - pose.position)
            for pose, end in zip(near, far, strict=True)]
    assert max(away) == pytest.approx(0.999 * 0.5)


def test_grippers_turn_no_more_than_their_tangent(recorded):
    grippers, _ = Recording('', recorded).held(LENGTH)
    for one, other in zip(grippers[:-1], grippers[1:], strict=True):
        turn = np.arccos(np.clip((np.trace(one.rotation.T @ other.rotation) - 1) / 2, -1, 1))
        tilt = np.linalg.norm(np.cross(one.direction, other.direction))
        assert turn == pytest.approx(tilt, abs=1e-6)


def test_noise_of_the_clamped_markers_is_left_out(recorded):
    noisy = recorded + 1e-3 * np.random.default_rng(0).standard_normal(recorded.shape)
    true, found = recorded[:, 1] - recorded[:, 0], Recording('', noisy).held(LENGTH, lead=False)[0]
    along = np.array([pose.direction for pose in found])
    away = np.linalg.norm(along - true / np.linalg.norm(true, axis=1)[:, None], axis=1)
    # two markers 25 mm apart show it within 0.08 rad each time
    assert np.sqrt(np.mean(away**2)) < 0.03
    off = np.array([pose.position for pose in found]) - recorded[:, 1]
    assert np.sqrt(np.mean(off**2)) < 5e-4
    # it is shaken by less than a band of 5 Hz would let through
    jerks = np.diff(along, 3, axis=0) - np.diff(true, 3, axis=0) / np.linalg.norm(true[0])
    assert np.abs(jerks).max() < 1e-3


def test_another_engine_is_predicted_from_the_clamped_markers(recorded):
    one = Recording('', recorded)
    out, _ = deform.predicted(_cable(), one)
    away = np.abs(out - one.markers[2:])
    assert out.shape == (150, MARKERS, 3)
    assert away[:, 2:-2].mean() < 5e-4
    assert (away[:, [0, 1, -2, -1]] == 0).all()
    hidden = recorded.copy()
    hidden[:, 2:-2] = 7.0
    blind, _ = deform.predicted(_cable(), Recording('', hidden))
    np.testing.assert_array_equal(blind[:, 2:-2], out[:, 2:-2])
    stiff, _ = deform.predicted(_cable(15.0), one)
    assert np.abs(stiff - one.markers[2:])[:, 2:-2].mean() > 5e-3


def test_the_error_is_that_of_their_evaluation(recorded):
    score = deform.scored(_cable(), [Recording('a', recorded), Recording('b', recorded)])
    assert score.names == ('a', 'b')
    assert score.failed == 0
    # the four clamped markers count, without an error
    np.testing.assert_allclose(score.errors, score.free * (MARKERS - 4) / MARKERS)
    assert score.free.max() < 5e-4
    cable = _cable()
    fit = type('Fit', (), {'misfit': 1e-3, 'noise': 5e-4})
    cells = deform.line(5, deform.Cable(cable.rod, cable.s, fit, cable.effort, 2.0), score)
    assert len(cells) == len(deform.HEADS)
    assert cells[2] == '-'
    assert cells[5] == '0 of 2'
    assert cells[7] == '60'


def test_markers_below_the_floor_are_lifted_as_theirs():
    markers = np.zeros((5, 12, 3))
    markers[:, 3] = 1.0
    lifted = Recording('', markers).lifted(range(5))
    assert lifted[0, 3].tolist() == [1.0, 1.0, 1.0]
    assert lifted[0, 4].tolist() == [0.0, 0.0, 2e-3 + 1e-6]
    assert DT == 0.01


def test_noise_does_not_make_the_cable_longer(recorded):
    rng = np.random.default_rng(0)
    noisy = [Recording('', recorded + 1e-3 * rng.standard_normal(recorded.shape)) for _ in range(4)]
    off = arc_lengths(noisy) - arc_lengths([Recording('', recorded)])
    assert np.abs(off).max() < 3e-4  # each frame by itself: 1.2e-3
    assert noisy[0].noise == pytest.approx(1e-3, rel=0.1)
    assert Recording('', recorded).noise < 2e-5


def test_smoothing_says_how_far_it_may_be_off():
    rng, t = np.random.default_rng(1), np.linspace(0, 3, 300)
    true = np.column_stack([np.sin(2 * t), np.cos(3 * t), np.sin(3 * t + 1)])
    found = smoothed(true + 0.05 * rng.standard_normal(true.shape))
    assert found.noise == pytest.approx(0.05, rel=0.1)
    expected = np.sqrt(np.sum(found.doubts**2, axis=0).mean())
    assert np.sqrt(np.mean((found.values - true) ** 2)) == pytest.approx(expected, rel=0.4)


def test_what_is_left_in_doubt_covers_what_was_off(recorded):
    cable, rng = _cable(), np.random.default_rng(2)
    direct, frames = DirectSimulator(cable.rod, basis='local', n_elements=20), range(0, 100, 4)
    noisy = recorded.copy()
    noisy[:, [0, -1]] += 1e-3 * rng.standard_normal((len(noisy), 2, 3))
    one = Recording('', noisy)
    motion = deform._motion(one, frames, cable.s)
    columns = doubted(motion, one, frames, direct).displacements
    assert columns.shape[1:] == motion.points.shape
    assert 20 < len(columns) < 150
    away = (motion.points - deform_doubt._seen(direct, motion, np.inf)).ravel()
    flat = columns.reshape(len(columns), -1).T
    amounts = np.linalg.lstsq(np.vstack([flat / 1e-3, np.eye(len(columns))]),
                              np.append(away / 1e-3, np.zeros(len(columns))), rcond=None)[0]
    assert np.abs(away).max() > 3e-3           # the grippers are turned by their noise
    assert np.abs(away - flat @ amounts).max() < 1e-3
    assert np.abs(amounts).max() < 4


def off_at_rest(number, recorded):
    """Return the largest distance of free markers from the DLO at rest, m."""
    rod = deform_surrogate.CABLES[number].rod
    one = Recording('', recorded)
    grippers, ends = one.held(rod.length, lead=False)
    shape = DirectSimulator(rod, basis='local', n_elements=60).solve(grippers[0], far_end=ends[0])
    assert shape.converged
    s = np.linspace(0, rod.length, recorded.shape[1] - 2)
    return np.linalg.norm(shape.positions_at(s) - recorded[0, 1:-1], axis=1).max()


def test_a_cable_of_mujoco_begins_at_rest_where_it_hangs(monkeypatch):
    pytest.importorskip('mujoco')
    monkeypatch.setattr(deform_surrogate, '_BEFORE', 0)
    made = deform_surrogate.CABLES[4]
    recorded = deform_surrogate.recording(made, 400, 3)
    assert recorded.shape == (3, made.markers, 3)
    assert off_at_rest(4, recorded) < 3e-3  # it settles for 3 s; that the far end turns is 6 mm
    np.testing.assert_allclose(arc_lengths([Recording('', recorded)])[-1], made.length, rtol=2e-3)


# ---- files: numbers are read, code and what is no cable in meters is not --------------------


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


@pytest.mark.parametrize(('content', 'words'), [
    (b'version https://git-lfs.github.com/spec/v1', ''), (pickle.dumps({'a': 1}), ''),
    (pickle.dumps(hanging()), r'\(6, 12, 3\): expected \(frames, 3, markers\)'),
    (pickle.dumps(np.swapaxes(np.where(np.arange(12)[:, None] == 5, np.nan, hanging()), 1, 2)),
     'marker 5 is lost in frame 0')])
def test_what_is_no_recording_is_named_with_its_file(content, words, tmp_path):
    save(tmp_path, 3, 'train', [hanging(), hanging()])
    (tmp_path / 'data_set' / 'DLO3' / 'train' / '1.pkl').write_bytes(content)
    with pytest.raises(ValueError, match=rf'1\.pkl: .*{words}'):
        recordings(tmp_path, 3, 'train')


def test_the_command_says_what_is_missing_before_it_begins(tmp_path, capsys):
    save(tmp_path, 1, 'train', [hanging(90)])
    for words in ('0.pkl: 90 frames: expected 100 or more', 'eval: expected recordings'):
        with pytest.raises(SystemExit, match='2'):
            deform.main(['--data', str(tmp_path), '--cables', '1'])
        told = capsys.readouterr().err
        assert words in told and 'Traceback' not in told
        shutil.rmtree(tmp_path / 'data_set')
        save(tmp_path, 1, 'train', [hanging(100)])
