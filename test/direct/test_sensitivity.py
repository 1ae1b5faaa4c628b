# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a shape answers to its gripper, against differences of solved shapes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod, Sphere
from dlo_planner.direct.sensitivity import Sensitivity

ROD = {'length': 1.0, 'mass_per_length': 0.05, 'bending_stiffness': (0.3, 0.8),
       'torsional_stiffness': 0.4, 'tip_mass': 0.03, 'radius': 0.005}
GRIPPER = Pose((0, 0, 1), Rotation.from_rotvec([0.1, 0.3, 0.2]).as_quat())
END = Pose((0.6, 0.3, 0.8), Rotation.from_rotvec([0.3, 0.3, 0.9]).as_quat())
CASES = {
    'free': ({'natural_curvature': (1.0, -0.5), 'natural_twist': 2.0}, {}, None, 1e-8),
    'touching': ({'natural_curvature': (1.0, -0.5), 'natural_twist': 2.0}, {'obstacles': [
        Plane((0, 0, 0.8), (0.1, 0, 1)), Sphere((0.3, 0.0, 0.85), 0.06)]}, None, 1e-4),
    'held': ({}, {}, END, 1e-5),
    'yielding': ({'yield_curvature': 0.31, 'hardening': 0.1}, {}, None, 1e-8),
    'fibers': ({'yield_curvature': 0.15, 'yield_torsion': 0.05, 'section_model': 'round',
                'hardening': 0.1}, {}, None, 1e-5)}


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('case', CASES)
def test_against_differences(case, basis):
    more, options, end, tolerance = CASES[case]
    simulator = DirectSimulator(Rod(**ROD, **more), basis=basis, **options)
    before = simulator.solve(Pose((0, 0, 1), (0, 0, 0, 1)), far_end=end)
    shape = simulator.solve(GRIPPER, before, far_end=end)
    answer = Sensitivity(shape)
    step = 1e-5
    for s in (0.3, 1.0):
        slopes = np.zeros((6, 6))
        for k, twist in enumerate(step * np.eye(6)):
            up, down = (simulator.solve(Pose.from_rotation(
                GRIPPER.position + sign * twist[3:],
                Rotation.from_rotvec(sign * twist[:3]).as_matrix() @ GRIPPER.rotation),
                before, far_end=end).at(s) for sign in (1, -1))
            slopes[:3, k] = Rotation.from_matrix(up.rotation @ down.rotation.T).as_rotvec()
            slopes[3:, k] = up.position - down.position
        np.testing.assert_allclose(answer.at(s), slopes / (2 * step), atol=tolerance)


def test_a_shape_from_a_file_is_refused(tmp_path, wire, level):
    shape = DirectSimulator(wire).solve(level)
    shape.save(tmp_path / 'a.npz')
    with pytest.raises(InvalidTask, match='shape'):
        Sensitivity(type(shape).load(tmp_path / 'a.npz'))


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_what_yields_in_the_step_goes_on_yielding(basis):
    # moved a little farther on its way it yields a little more, and no longer springs back alone
    rod = Rod(**ROD, yield_curvature=0.3, hardening=0.1)
    simulator = DirectSimulator(rod, basis=basis)
    shape = simulator.solve(GRIPPER)
    assert shape.dissipated > 0
    answer, step = Sensitivity(shape), 1e-5
    elastic = Sensitivity(DirectSimulator(rod, basis=basis).solve(GRIPPER, shape))
    slopes = np.zeros((6, 6))
    for k, twist in enumerate(step * np.eye(6)):
        up, down = (simulator.solve(Pose.from_rotation(
            GRIPPER.position + sign * twist[3:],
            Rotation.from_rotvec(sign * twist[:3]).as_matrix() @ GRIPPER.rotation)).at(1.0)
            for sign in (1, -1))
        slopes[:3, k] = Rotation.from_matrix(up.rotation @ down.rotation.T).as_rotvec()
        slopes[3:, k] = up.position - down.position
    np.testing.assert_allclose(answer.at(1.0), slopes / (2 * step), atol=1e-7)
    assert np.abs(elastic.at(1.0) - answer.at(1.0)).max() > 0.01  # as it would be, let go
