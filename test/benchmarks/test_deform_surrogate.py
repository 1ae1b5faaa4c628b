# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cables of other engines: what they record is what this package finds, as they were made."""

import numpy as np
import pytest

from benchmarks import deform_surrogate
from benchmarks.deform_data import Recording, arc_lengths
from dlo_planner import DirectSimulator


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
