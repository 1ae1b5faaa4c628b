# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How points of many shapes move with what is uncertain: at once as one by one, and as they do."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod, Uncertainty
from dlo_planner.direct.sensitivity import HangingSensitivities
from dlo_planner.uncertainty.state import UncertainState

ROD = Rod(1.0, 0.1, (0.05, 0.08), 0.04, natural_curvature=(0.8, -0.5), radius=2e-3, tip_mass=0.01)
ALL = Uncertainty(bending_stiffness=0.02, torsional_stiffness=0.03, mass=0.01, length=1e-3,
                  natural_curvature=0.02, gripper_position=1e-3, gripper_rotation=1e-3,
                  curvature_variation=0.05, mass_gradient=0.03)
S = np.array([0.11, 0.5, 0.875, 1.0])
MESHES = {'local': {'n_elements': 64, 'basis': 'local'}, 'chebyshev': {'basis': 'chebyshev'},
          'fourier': {'n_elements': 50, 'basis': 'fourier'}}


def grippers(count):
    return [Pose.looking_along((0.1 * k, 0.3, -0.2), (1.0, 0.2 * k, 0.3 - 0.1 * k))
            for k in range(count)]


@pytest.mark.parametrize('options', MESHES.values(), ids=MESHES)
def test_many_are_as_each_one(options):
    simulator = DirectSimulator(ROD, **options)
    shapes = simulator.track(grippers(5))
    assert HangingSensitivities.mesh_of(shapes) is shapes[0].state.mesh
    uncertain = UncertainState(simulator, ALL, 3)
    slopes, tangents = uncertain.moved(shapes, S)
    for shape, own, along in zip(shapes, slopes, tangents, strict=True):
        np.testing.assert_allclose(own, uncertain.slopes(np.zeros(uncertain.size), shape)(S),
                                   rtol=0, atol=1e-9)
        np.testing.assert_allclose(along, [shape.at(s).direction for s in S], atol=1e-12)


def test_points_move_as_the_slopes_say():
    simulator = DirectSimulator(ROD, n_elements=64, basis='local')
    shapes, uncertain, step = simulator.track(grippers(2)), UncertainState(simulator, ALL, 3), 1e-4
    slopes, _ = uncertain.moved(shapes, S)
    assert uncertain.size == 17
    for shape, own in zip(shapes, slopes, strict=True):
        for column in range(uncertain.size):
            ends = []
            for side in (-1, 1):
                z = np.zeros(uncertain.size)
                z[column] = side * step * (0.1 if 'length' in uncertain.names[column] else 1)
                rod = uncertain.rod(z)
                there = DirectSimulator(rod, n_elements=64, basis='local').solve(
                    shape.gripper.compose(uncertain.offset(z)))
                ends.append(there.positions_at(S * rod.length / ROD.length))
                assert there.converged
            found = (ends[1] - ends[0]) / (2 * abs(z[column]))
            np.testing.assert_allclose(own[:, :, column], found, atol=2e-4 * max(
                1.0, np.abs(found).max()), err_msg=uncertain.names[column])


def test_what_does_not_hang_on_one_mesh_is_looked_at_one_by_one():
    lying = DirectSimulator(ROD, n_elements=32, basis='local',
                            obstacles=[Plane((0, 0, -0.3), (0, 0, 1))])
    shapes = [lying.track([Pose.looking_along((0, 0, -0.2), (1, 0, 0))])[-1],
              DirectSimulator(ROD, n_elements=40, basis='local').solve(grippers(1)[0])]
    assert shapes[0].contacts and HangingSensitivities.mesh_of(shapes[:1]) is None
    assert HangingSensitivities.mesh_of(shapes) is None
    assert HangingSensitivities.mesh_of([shapes[1].moved((1, 0, 0))]) is shapes[1].state.mesh
    uncertain = UncertainState(DirectSimulator(ROD), Uncertainty(mass=0.01), 1)
    slopes, _ = uncertain.moved(shapes, S)
    for shape, own in zip(shapes, slopes, strict=True):
        np.testing.assert_array_equal(own, uncertain.slopes(np.zeros(1), shape)(S))


def test_a_pinned_one_is_refused():
    pinned = DirectSimulator(ROD, grip='pinned')
    shape = pinned.solve(grippers(1)[0])
    with pytest.raises(InvalidTask, match='pinned'):
        UncertainState(DirectSimulator(ROD), Uncertainty(mass=0.01), 1).moved([shape], S)
