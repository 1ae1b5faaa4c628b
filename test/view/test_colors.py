# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from dlo_planner import DirectSimulator, InvalidTask, Pose, Rod
from dlo_planner.view.colors import ALERT, GRAY, coloring, viridis

LEVEL = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))


def solved(**more):
    rod = Rod(1.0, 0.1, 0.5, 0.4, **more)
    return DirectSimulator(rod, n_elements=12, n_terms=6).solve(LEVEL)


def test_viridis_is_matplotlibs():
    colormaps = pytest.importorskip('matplotlib').colormaps
    share = np.linspace(0, 1, 200)
    np.testing.assert_allclose(viridis(share), colormaps['viridis'](share)[:, :3], atol=0.03)


def test_beyond_the_limit_and_not_known_stand_out():
    np.testing.assert_array_equal(viridis([1.01, np.inf, np.nan]), [ALERT, ALERT, GRAY])


def test_brightness_grows_with_the_share():
    # what those see who see no colors: luminance after ITU-R BT.709
    luminance = viridis(np.linspace(0, 1, 50)) @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(luminance) > 0).all()


def test_curvature_is_a_part_of_the_sharpest_or_of_the_limit():
    free = coloring(solved())
    sharpest = np.linalg.norm(solved().strains[:, 1:], axis=1).max()
    np.testing.assert_allclose(free.colors[0], viridis([1.0])[0])
    assert free.caption == f'curvature: 0 to {sharpest:.3g} 1/m'
    limited = coloring(solved(max_bend_curvature=0.5 * sharpest))
    np.testing.assert_array_equal(limited.colors[0], ALERT)
    assert (limited.colors[-1] != ALERT).any()
    assert limited.caption.endswith('1/m (limit)')


def test_yield_is_the_part_of_the_limit_that_is_used():
    rod = {'yield_curvature': 100.0, 'yield_torsion': 100.0}
    shape = solved(**rod)
    bend = np.hypot(*shape.strains[:, 1:].T).max() / 100.0  # at the clamp
    drawn = coloring(shape, 'yield')
    np.testing.assert_allclose(drawn.colors[0], viridis([bend])[0])
    assert drawn.caption.endswith(f'largest {bend:.2g}')
    assert 'never yields' in coloring(solved(), 'yield').caption


def test_a_shape_from_a_file_has_no_yield_limit(tmp_path):
    shape = solved(yield_curvature=9.0)
    shape.save(tmp_path / 'shape.npz')
    drawn = coloring(type(shape).load(tmp_path / 'shape.npz'), 'yield')
    assert 'not known' in drawn.caption
    np.testing.assert_array_equal(drawn.colors, np.tile(GRAY, (len(shape.s), 1)))


def test_a_straight_dlo_is_dark():
    weightless = DirectSimulator(Rod(1.0, 0.0, 1.0, 1.0), n_elements=4, n_terms=2).solve(LEVEL)
    np.testing.assert_allclose(coloring(weightless).colors, np.tile(viridis([0.0]), (5, 1)),
                               atol=1e-6)


def test_another_color_is_refused():
    with pytest.raises(InvalidTask, match="color = 'rainbow': expected one of 'curvature'"):
        coloring(solved(), 'rainbow')
