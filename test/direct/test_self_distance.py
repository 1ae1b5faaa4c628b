# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a DLO comes to itself, and that no plan takes one that lies in itself."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, Infeasible, InverseSimulator, Pose, Rod, Shape
from dlo_planner.rods import GraspedInside

HERE = Pose.identity()


def bent(length, curvature, twist=0.0, elements=100, **more):
    """Return the Shape of a weightless DLO, as it was made."""
    rod = Rod(length, 1.0, 1.0, 0.7, **{'radius': 0.01, **more}, natural_curvature=curvature,
              natural_twist=twist)
    return DirectSimulator(rod, n_elements=elements, basis='local',
                           gravity=(0, 0, 0)).solve(HERE)


def helix(turns, wide, pitch, **more):
    rise = pitch / (2 * np.pi)
    square = wide**2 + rise**2
    return bent(2 * np.pi * turns * np.sqrt(square), (0.0, wide / square), rise / square, **more)


@pytest.mark.parametrize(('turns', 'pitch', 'elements'), [
    (3.5, 0.05, 60), (3.5, 0.05, 300), (8.2, 0.022, 400), (1.1, 0.1, 40)])
def test_windings_of_a_helix(turns, pitch, elements):
    shape = helix(turns, 0.1, pitch, elements=elements)
    true = np.sqrt(minimize_scalar(
        lambda x: 2 * 0.01 * (1 - np.cos(x)) + (pitch * x / (2 * np.pi))**2, bounds=(4, 8),
        options={'xatol': 1e-12}).fun)
    assert shape.self_distance == pytest.approx(true, abs=1e-6 * shape.s[-1])
    assert not shape.lies_in_itself and 'itself' not in shape.status
    thick = helix(turns, 0.1, pitch, elements=elements, radius=0.501 * true)
    assert thick.lies_in_itself and thick.status == 'converged, lies in itself'
    assert 'lies in itself' in repr(thick)


@pytest.mark.parametrize('turn', [0.3, 1.5, 3.0])
def test_a_plain_bend_does_not_come_back(turn):
    assert bent(1.0, (0.0, turn)).self_distance == np.inf  # up to half a circle
    # a hairpin, as tight as its own thickness allows: twice the radius of the bend, no less
    tight = bent(1.0, lambda s: (0.0, (turn + 0.1) / 0.1 if 0.4 < s < 0.5 else 0.0),
                 radius=0.999 * 0.1 / (turn + 0.1))
    assert not tight.lies_in_itself and tight.self_distance >= 2 * 0.1 / (turn + 0.1) * 0.999


def test_a_ring_of_more_than_one_turn_lies_in_itself():
    assert bent(1.0, (0.0, 6.0)).self_distance == pytest.approx(2 / 6 * np.sin(3.0), abs=1e-6)
    ring = bent(1.0, (0.0, 7.0))
    assert ring.self_distance < 1e-6 and ring.lies_in_itself


def test_where_it_is_thin_it_may_come_nearer():
    def radius(s):
        return 0.004 if s < 0.3 else 0.02

    pitch = 0.03  # of four turns; the first one is thin
    thick = helix(4.0, 0.05, pitch, radius=radius)
    assert thick.lies_in_itself
    thin = helix(1.3, 0.05, pitch, radius=radius)  # only its thin first part has another beside it
    assert not thin.lies_in_itself and thin.self_distance < 0.04


def test_what_is_not_known_is_nan(tmp_path):
    assert np.isnan(bent(1.0, (0.0, 7.0), radius=None).self_distance)
    shape = bent(1.0, (0.0, 7.0))
    shape.save(tmp_path / 'shape.npz')
    loaded = Shape.load(tmp_path / 'shape.npz')
    assert np.isnan(loaded.self_distance) and np.isnan(loaded.lies_in_itself)
    assert 'lies_in_itself' in loaded.not_looked_at and 'itself' not in loaded.status


def test_one_grasped_inside_is_looked_at_as_a_whole():
    rod = Rod(1.0, 1.0, 1.0, 0.7, radius=0.01, natural_curvature=(0.0, 7.0))
    grasped = GraspedInside(rod, 0.5, gravity=(0, 0, 0)).solve(HERE)
    assert all(part.self_distance > 0.2 for part in grasped.parts)
    assert grasped.lies_in_itself


def test_no_plan_takes_a_dlo_that_lies_in_itself():
    goal = CutOut(Pose.looking_along((1, 0, 0), (1, 0, 0)))
    for radius, refused in ((0.02, True), (0.002, False)):
        rod = Rod(1.0, 1e-3, 1.0, 0.7, radius=radius,
                  natural_curvature=lambda s: (0.0, 12.5 if s < 0.5 else 0.0), natural_twist=1.0)
        inverse = InverseSimulator(DirectSimulator(rod))
        if not refused:
            assert inverse.thread(goal, depths=[0, 0.1, 0.2]).shapes[0].self_distance < 0.04
            continue
        with pytest.raises(Infeasible, match='in itself') as error:
            inverse.thread(goal, depths=[0, 0.1, 0.2])
        assert error.value.constraint == 'self_distance' and error.value.amount > 0


def test_frames_do_not_matter(rng):
    shape = helix(2.5, 0.1, 0.04)
    direct = DirectSimulator(shape.rod, n_elements=100, basis='local', gravity=(0, 0, 0))
    there = Pose(rng.normal(size=3), Rotation.random(random_state=1).as_quat())
    assert direct.solve(there).self_distance == pytest.approx(shape.self_distance, rel=1e-9)
