# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Saved shapes at the door: what they say of the past is judged before kernels take it."""

import json
import os

import numpy as np
import pytest
from specimens import LEVEL, values

from dlo_planner import DirectSimulator, InvalidTask, Plan, Plane, Rod, Shape
from dlo_planner.model.pose import Pose

SOFT = Rod(1.0, 0.1, 0.05, 0.04, radius=0.01, yield_curvature=1.0, hardening=0.1)
AROUND = DirectSimulator(SOFT, n_elements=8, n_terms=4, obstacles=[
    Plane((0, 0, 0.6), (0, 0, 1), 0.3)])


@pytest.fixture(scope='module')
def saved(tmp_path_factory):
    """Return what a file holds of a DLO that has yielded, lies on a plane and rubs there."""
    path = tmp_path_factory.mktemp('saved') / 'shape.json'
    shape = AROUND.track([LEVEL, Pose((0, 0, 0.9), (0, 0, 0, 1))])[-1]
    assert shape.contacts and shape.dissipated > 0
    shape.save(path)
    assert Shape.load(path) == shape
    return json.loads(path.read_text())


def described(array):
    return {'type': {'f': 'float', 'i': 'int'}[array.dtype.kind], 'shape': list(array.shape),
            'data': [one if np.isfinite(one) else str(one) for one in array.ravel().tolist()]}


def array_of(one):
    return np.array(one['data'], dtype=one['type']).reshape(one['shape'])


def odd(name, array):
    """Yield what an array of the past cannot be: of another shape, kind, or not finite."""
    yield np.zeros((*array.shape, 2))
    if array.ndim and name != 'node_force':  # there may be another body
        yield np.concatenate([array, array])[:len(array) + 1] if array.size else np.zeros((3, 2, 2))
    if array.size:
        yield np.full(array.shape, np.nan)


@pytest.mark.parametrize('name', [
    'set', 'lost', 'node_force', 's', 'positions', 'tangents', 'point_element', 'point_obstacle',
    'point_multiplier', 'point_fraction', 'point_anchor', 'point_normal', 'point_shear'])
def test_a_past_that_cannot_be_is_refused_by_name(tmp_path, saved, name):
    path, tried = tmp_path / 'odd.json', 0
    for content in odd(name, array_of(saved[f'past_{name}'])):
        path.write_text(json.dumps(saved | {f'past_{name}': described(content)}))
        with pytest.raises(InvalidTask, match='odd.json.*past_'):
            Shape.load(path)
        tried += 1
    assert tried


@pytest.mark.parametrize(('name', 'content', 'said'), [
    ('point_element', 10**6, 'integers'), ('point_element', -1, 'from 0 to 6|from 0 to 7'),
    ('point_obstacle', -2, 'from -1 to 0'), ('point_fraction', 1.5, 'from -1 to 1'),
    ('s', 2.0, 'arc lengths that grow from 0 to 1'), ('lost', -1.0, 'from 0')])
def test_numbers_that_kernels_would_index_by_are_in_range(tmp_path, saved, name, content, said):
    array = array_of(saved[f'past_{name}'])
    assert array.size
    array.flat[-1] = content
    path = tmp_path / 'odd.json'
    path.write_text(json.dumps(saved | {f'past_{name}': described(array)}))
    with pytest.raises(InvalidTask, match=f'past_{name}.*({said})'):
        Shape.load(path)


def test_a_missing_part_of_the_past_is_named(tmp_path, saved):
    path = tmp_path / 'odd.json'
    path.write_text(json.dumps({name: one for name, one in saved.items() if name != 'past_lost'}))
    with pytest.raises(InvalidTask, match='past_lost'):
        Shape.load(path)


@pytest.mark.every(5)
@pytest.mark.parametrize('name', ['', '.', 'none/', 'there', 'pipe.npz', 'pipe', 'pipe.json',
                                  'file.npz/x.npz', 'no/such.npz', 'a\0.npz', 'x' * 300 + '.npz'])
@pytest.mark.parametrize('kind', ['Shape', 'Plan', 'Motion', 'ValidationReport'])
def test_what_is_no_name_of_a_file_is_refused(tmp_path, monkeypatch, name, kind):
    monkeypatch.chdir(tmp_path)
    os.mkfifo('pipe.npz')
    os.mkfifo('pipe.json')
    (tmp_path / 'there').mkdir()
    (tmp_path / 'file.npz').write_bytes(b'')
    before = sorted(tmp_path.rglob('*'))
    with pytest.raises(InvalidTask, match='path = '):
        values()[kind].save(name)
    with pytest.raises(InvalidTask, match='path = '):
        type(values()[kind]).load(name)
    assert sorted(tmp_path.rglob('*')) == before and sorted(tmp_path.parent.glob('.npz')) == []


def test_a_name_without_an_ending_is_one_of_npz(tmp_path):
    values()['Plan'].save(tmp_path / 'plan')
    assert Plan.load(tmp_path / 'plan.npz') == values()['Plan']
