# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All ways to hang, and where threadings can begin."""

import numpy as np
import pytest
from references.hanging import hanging_and_stable
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.inverse.continuation import Aligned, TwoPoints
from dlo_planner.inverse.equilibria import (
    hanging_shapes,
    integrate_from_tip,
    is_axisymmetric,
)

ROD = Rod(1.0, 0.1, (0.1, 0.3), 0.1, natural_curvature=(0.6, -0.4), natural_twist=0.3)
WEIGHT = np.array([0, 0, -9.81 * 0.1])


@pytest.fixture(scope='module')
def shapes():
    return hanging_shapes(DirectSimulator(ROD).surroundings, np.linspace(0, 1, 65))


def test_shapes_and_their_stability_against_runge_kutta(shapes):
    some = np.arange(0, len(shapes.frames), 50)
    frames, stable = hanging_and_stable(ROD, WEIGHT, shapes.frames[some, -1], steps=64)
    np.testing.assert_allclose(np.swapaxes(frames, 0, 1), shapes.frames[some], atol=3e-3)
    assert 0.1 < stable.mean() < 0.95
    clear = np.abs(shapes.stability[some]) > 0.02
    assert ((shapes.stability[some] > 0) == stable)[clear].all()


@pytest.mark.parametrize('normal', [(1, 0.2, -0.3), (0, 0, -1), (-0.2, 0.5, 0.4)])
@pytest.mark.parametrize('depth', [0.0, 0.4])
def test_crossings_do_the_task_about(shapes, normal, depth):
    goal = CutOut(Pose.looking_along((0, 0, 0), normal))
    direct = DirectSimulator(ROD)
    found = Aligned(direct, goal.normal).crossings(shapes, depth)
    assert len(found) > 5 and (shapes.stability[found.pairs] > 0).all()
    for k in range(0, len(found), 7):
        shape = direct.solve(Pose.from_rotation((0, 0, 0), found.grippers[k]))
        if np.abs(shape.frames[-1] - found.ends[k]).max() < 0.05:  # the DLO gets into it by itself
            axes, position = shape.frame_at(1 - depth)
            np.testing.assert_allclose(axes[:, 0], goal.normal, atol=0.05)
            np.testing.assert_allclose(found.places[k], -position, atol=0.05)


def test_crossings_of_two_points_do_the_task_about(shapes):
    way = np.array([0.25, 0.1, -0.05])
    direct = DirectSimulator(ROD)
    task = TwoPoints(direct, way)
    found, depths = task.last_crossings(shapes)
    assert len(found) > 5 and (depths > np.linalg.norm(way)).all()
    hits = 0
    for k in range(0, len(found), 7):
        shape = direct.solve(Pose.from_rotation((0, 0, 0), found.grippers[k]))
        if np.abs(shape.frames[-1] - found.ends[k]).max() < 0.05:
            reached = shape.positions[-1] - shape.frame_at(1 - depths[k])[1]
            np.testing.assert_allclose(reached, way, atol=0.03)
            hits += task.from_end(shape, depths[k]) is not None
    assert hits > 2


def test_there_is_no_sphere_without_one_direction_of_load():
    for given in ({'gravity': (0, 0, 0)}, {'load': lambda s: (0.1 * s, 0, 0)}):
        assert hanging_shapes(DirectSimulator(ROD, **given).surroundings,
                              np.linspace(0, 1, 9)) is None
    weightless = InverseSimulator(DirectSimulator(ROD, gravity=(0, 0, 0)))
    assert weightless.thread(CutOut(Pose.identity()), depths=[0.0, 0.5]).fraction == 1


def test_a_way_with_sharp_turns_is_found_as_well():
    # found from other rolls to begin with; smoothed, the route leads through unstable shapes
    rod = Rod(1.0, 0.05, (0.154177909812173, 3.5720077822874683), 0.05554659528170239,
              natural_curvature=(3.1776148781720446, 0.40727826977359327),
              natural_twist=-1.4938595013810794, tip_mass=0.0348074728041803)
    cutout = CutOut(Pose((2.03109252, 0.25657722, 0.24470148),
                         (-0.00349648, -0.01835972, -0.18704776, 0.98217302)))
    direct, depths = DirectSimulator(rod, basis='chebyshev'), np.linspace(0, 0.95, 20)
    plan = InverseSimulator(direct).thread(cutout, depths=depths)
    for depth, shape in zip(depths, direct.track(plan.grippers), strict=True):
        axes, position = shape.frame_at(1 - depth)
        assert shape.converged and not shape.jumped
        np.testing.assert_allclose(position, cutout.center, atol=1e-9)
        np.testing.assert_allclose(axes[:, 0], cutout.normal, atol=1e-6)


START_ROD = Rod(1.0, 0.1, (0.5, 1.0), 0.4, natural_curvature=(0.6, -0.3), natural_twist=0.5,
          tip_mass=0.02)


def test_the_march_from_the_end_is_an_equilibrium(rng):
    end = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    direct = DirectSimulator(START_ROD, basis='local', n_elements=12)
    system = direct.mesh.system(np.eye(3))
    strains, base = integrate_from_tip(system, np.ascontiguousarray(end))
    turned = system._replace(base=base)
    state = new_configuration(turned)
    state.q[:] = (strains - turned.natural) / turned.scale
    evaluate(turned, state)
    np.testing.assert_allclose(state.gradient, 0, atol=1e-13)
    np.testing.assert_allclose(state.rotations[-1], end, atol=1e-13)


@pytest.mark.parametrize(('more', 'alike'), [
    ({}, True), ({'natural_curvature': (0.3, 0.0)}, False), ({'natural_twist': 0.5}, False),
    ({'natural_curvature': lambda s: (0.0, max(0.0, s - 0.9))}, False),
    ({'bending_stiffness': (0.5, 0.6)}, False), ({'tip_mass': 0.1}, True)])
def test_rolls_are_alike_where_the_dlo_is_straight_and_round(more, alike):
    rod = Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 0.5,
                 'torsional_stiffness': 0.4, **more})
    assert is_axisymmetric(rod) == alike
