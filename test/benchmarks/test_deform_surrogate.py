# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cables of other engines: what they record is what this package finds, as they were made."""

import numpy as np
import pytest

from benchmarks import deform_surrogate
from benchmarks.deform_data import Recording, arc_lengths
from dlo_planner import DirectSimulator

pytestmark = pytest.mark.sweep  # the package has tests of its own


def away(number, recorded):
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
    assert away(4, recorded) < 3e-3  # it settles for 3 s; that the far end turns is 6 mm
    np.testing.assert_allclose(arc_lengths([Recording('', recorded)])[-1], made.length, rtol=2e-3)


def test_a_row_says_what_is_covered():
    made = deform_surrogate.CABLES[2]
    cable = deform_surrogate.known(2, None)
    fit = type('Fit', (), {
        'misfit': 2e-3, 'noise': 1e-3, 'values': {'damping': (1.4, 1e-3)}, 'deviations': {
            'damping': (0.1, 1e-4), 'bending_stiffness': (0.02 * made.rod.stiffness[1],) * 2}})
    cable = deform_surrogate.deform.Cable(cable.rod, cable.s, fit, None, 1.0)
    spread, off = deform_surrogate.covered(made, cable)
    assert spread == pytest.approx(0.02 * made.softness)
    np.testing.assert_allclose(off, [0, 2, 10], atol=1e-9)
    score = deform_surrogate.deform.Score(('a', 'b'), np.array([1e-3, np.nan]),
                                          np.array([2e-3, np.nan]), np.array([1.0, 2.0]))
    cells = deform_surrogate.line(2, cable, score)
    assert len(cells) == len(deform_surrogate.HEADS)
    assert cells[6] == '2 of 3'
    assert '1 of 2 not predicted' in deform_surrogate.said(2, score)


def test_natural_curvature_is_compared_with_what_it_was_made_of():
    fit = type('Fit', (), {
        'values': {'natural_curvature': ((1.1, 0.3), (0.4, 0.45), (0.8, 0.05))},
        'deviations': {'natural_curvature': ((0.1, 0.1), (0.1, 0.1), (0.1, 0.01))}})
    data = deform_surrogate.bent(4, type('Cable', (), {'fit': fit}))
    np.testing.assert_allclose(data['made'], [[1.0, 0.3], [0.4, 0.8], [0.8, 0.0]], atol=1e-12)
    assert deform_surrogate.bent_line('4', data) == [
        '4', '1, 0.3; 0.4, 0.8; 0.8, 0', '1.10 ± 0.10, 0.30 ± 0.10; 0.40 ± 0.10, 0.45 ± 0.10; '
        '0.80 ± 0.10, 0.05 ± 0.01', '4 of 6']


def test_a_table_keeps_the_rows_of_other_cables(tmp_path):
    heads, bends = deform_surrogate.HEADS, {'made': [[1, 0]], 'found': [[1, 0]],
                                            'deviations': [[1, 1]]}
    rows = {number: [number, *(f'{number} {k}' for k in range(1, len(heads)))] for number in '135'}
    deform_surrogate.write(tmp_path, {'3': rows['3']}, {'3': {'fit_s': 3}})
    deform_surrogate.write(tmp_path, {'1': rows['1']}, {'1': {'natural_curvature': bends}})
    deform_surrogate.write(tmp_path, {'5': rows['5']}, {'5': {'fit_s': 5}})
    found, data = deform_surrogate.kept(tmp_path)
    assert found == rows and list(data) == ['1', '3', '5'] and data['3'] == {'fit_s': 3}
    again = [*rows['3'][:-1], 'new']
    deform_surrogate.write(tmp_path, {'3': again}, {'3': {'fit_s': 4}})
    found, data = deform_surrogate.kept(tmp_path)
    assert found == {**rows, '3': again} and data['3'] == {'fit_s': 4}
    text = (tmp_path / 'deform_surrogate.md').read_text()
    assert text.count('| 1 | 1, 0 |') == 1  # the other table
    text = text.replace(heads[1], 'other')
    (tmp_path / 'deform_surrogate.md').write_text(text)
    assert deform_surrogate.kept(tmp_path) == ({}, {})
