# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Records: the same arrays on both sides, fixed fields, other processes."""

import pickle

import numpy as np
import pytest
from numba import njit
from numba.core.errors import NumbaError

from dlo_planner import Rod
from dlo_planner.energy.plastic import PlasticSection, yielding_layers
from dlo_planner.geometry.kinematics import nothing_attached
from dlo_planner.geometry.record import replaced


@njit
def doubled(layers):
    layers.set[:] *= 2
    return layers


@njit
def tied(layers, limit):
    return replaced(layers, 'limit', limit, 'share', layers.limit)


@njit
def mistaken(layers):
    return replaced(layers, 'none such', layers.limit)


@pytest.fixture
def layers():
    made = yielding_layers(Rod(1.0, 0.1, 1.0, 0.7, yield_curvature=0.3), np.ones((2, 3)))
    return made._replace(set=np.arange(6.0).reshape(2, 3))


def test_kernels_work_on_the_same_arrays(layers):
    back = doubled(layers)
    np.testing.assert_array_equal(layers.set, 2 * np.arange(6).reshape(2, 3))
    np.testing.assert_array_equal(back.set, layers.set)
    back.set[0, 0] = 7
    assert layers.set[0, 0] == 7


def test_what_a_kernel_makes_can_be_read():
    attached = nothing_attached(3, np.array([1, 4]))
    assert attached.element.tolist() == [1, 4] and attached.node_moment.shape == (3, 3)
    with pytest.raises(AttributeError, match='nothing'):
        _ = attached.nothing


def test_fields_are_replaced_not_set(layers):
    other = layers._replace(share=np.zeros(1))
    assert other.set is layers.set and not other.share.any() and layers.share.all()
    with pytest.raises(AttributeError, match='PlasticSection.set'):
        layers.set = None


def test_kernels_replace_fields(layers):
    limit = np.full(3, 2.0)
    for other in (tied(layers, limit), tied.py_func(layers, limit)):
        assert other.limit is not layers.limit and other.limit.tolist() == limit.tolist()
        np.testing.assert_array_equal(other.share, layers.limit)
        np.testing.assert_array_equal(other.set, layers.set)
    with pytest.raises(NumbaError):
        mistaken(layers)


def test_it_can_be_sent(layers):
    there = pickle.loads(pickle.dumps(layers))
    for name in PlasticSection.FIELDS:
        np.testing.assert_array_equal(getattr(there, name), getattr(layers, name))
    doubled(there)
