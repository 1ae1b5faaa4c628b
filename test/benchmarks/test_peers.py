# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The reference of the peers against the package; the peers that are always there."""

import numpy as np
import pytest

from benchmarks.peers import boundary, descent, ours
from benchmarks.peers.compare import error_of
from benchmarks.peers.reference import CASES, Reference

pytestmark = pytest.mark.sweep  # the package has tests of its own


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.name[0])
def test_the_package_agrees_with_the_reference(case):
    assert error_of(ours.prepare(case, 1e-5)(), Reference(case)) < 1e-5


def test_the_reference_keeps_the_length_and_the_grip():
    reference, s = Reference(CASES[0]), np.linspace(0, 1, 20001)
    places = reference(0, s)
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).sum() == pytest.approx(1, abs=1e-5)
    np.testing.assert_allclose(places[1] / s[1], [1, 0], atol=5e-4)


def test_errors_of_peers_fall():
    reference = Reference(CASES[0])
    assert error_of(boundary.prepare(CASES[0], 1e-7)(), reference) < 1e-8
    coarse, fine = (error_of(descent.prepare(CASES[0], n)(), reference) for n in (16, 32))
    assert 3 < coarse / fine < 5
