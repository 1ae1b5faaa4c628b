# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What must hold for any rod and pose, whatever the numbers."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Pose, Rod

unit = st.floats(-1, 1)
triples = st.tuples(unit, unit, unit)
rods = st.builds(
    lambda load, ratio, gj, bend, twist: Rod(1.0, load, (1.0, ratio), gj, natural_curvature=bend,
                                             natural_twist=twist),
    st.floats(0.01, 1.0), st.floats(1.0, 5.0), st.floats(0.4, 1.5), st.tuples(unit, unit), unit)
some = settings(max_examples=25, deadline=None, derandomize=True)


@some
@given(rods, triples, triples)
def test_turning_gripper_and_gravity_together_turns_the_shape(rod, pose, turn):
    rotation = Rotation.from_rotvec(turn)
    start = Rotation.from_rotvec(pose)
    gravity = np.array([0, 0, -9.81])
    one = DirectSimulator(rod, gravity=gravity).solve(Pose((0, 0, 0), start.as_quat()))
    two = DirectSimulator(rod, gravity=rotation.apply(gravity)).solve(
        Pose((0, 0, 0), (rotation * start).as_quat()))
    np.testing.assert_allclose(two.positions, one.positions @ rotation.as_matrix().T, atol=1e-8)


@some
@given(rods, triples, triples)
def test_shape_does_not_depend_on_where_the_gripper_is(rod, pose, shift):
    quaternion = Rotation.from_rotvec(pose).as_quat()
    simulator = DirectSimulator(rod)
    here = simulator.solve(Pose((0, 0, 0), quaternion))
    there = simulator.solve(Pose(shift, quaternion))
    moved = here.moved(shift)
    np.testing.assert_allclose(there.positions, moved.positions, atol=1e-12)
    assert abs(there.energy - moved.energy) < 1e-9


@some
@given(rods, triples, st.floats(0.1, 10.0))
def test_scaling_length_scales_the_shape(rod, pose, factor):
    # EI / (w L^3) is all that matters
    larger = Rod(factor, rod.mass_per_length, tuple(factor**3 * k for k in rod.bending_stiffness),
                 factor**3 * rod.torsional_stiffness,
                 natural_curvature=tuple(k / factor for k in rod.natural_curvature),
                 natural_twist=rod.natural_twist / factor)
    gripper = Pose((0, 0, 0), Rotation.from_rotvec(pose).as_quat())
    one, two = (DirectSimulator(r).solve(gripper) for r in (rod, larger))
    np.testing.assert_allclose(two.positions, factor * one.positions, atol=1e-8 * factor)


@some
@given(rods, triples)
def test_mirrored_rod_hangs_mirrored(rod, pose):
    mirror = np.array([1.0, -1.0, 1.0])  # y -> -y; rotation vectors are axial
    other = Rod(1.0, rod.mass_per_length, rod.bending_stiffness, rod.torsional_stiffness,
                natural_curvature=(rod.natural_curvature[0], -rod.natural_curvature[1]),
                natural_twist=-rod.natural_twist)
    turn = Rotation.from_rotvec(pose)
    mirrored = Rotation.from_rotvec(-mirror * np.array(pose))
    one = DirectSimulator(rod).solve(Pose((0, 0, 0), turn.as_quat()))
    two = DirectSimulator(other).solve(Pose((0, 0, 0), mirrored.as_quat()))
    np.testing.assert_allclose(two.positions, one.positions * mirror, atol=1e-8)


@some
@given(rods, triples)
def test_shape_has_less_energy_than_the_straight_one_and_its_length(rod, pose):
    gripper = Pose((0, 0, 0), Rotation.from_rotvec(pose).as_quat())
    shape = DirectSimulator(rod).solve(gripper)
    unbent = DirectSimulator(rod, gravity=(0, 0, 0)).solve(gripper)
    masses = np.full(65, rod.mass_per_length / 64)
    masses[[0, -1]] /= 2
    natural_energy = 9.81 * masses @ unbent.positions[:, 2]
    assert shape.converged
    assert shape.energy <= natural_energy + 1e-12
    chords = np.linalg.norm(np.diff(shape.positions, axis=0), axis=1)
    assert (chords <= np.diff(shape.s) + 1e-15).all()
    frames = np.einsum('kji,kjl->kil', shape.frames, shape.frames)
    np.testing.assert_allclose(frames, np.broadcast_to(np.eye(3), frames.shape), atol=1e-12)


@some
@given(triples, st.floats(-3, 3))
def test_rolling_a_round_straight_rod_changes_nothing(pose, roll):
    rod = Rod(1.0, 0.3, 1.0, 0.75)
    simulator = DirectSimulator(rod)
    turn = Rotation.from_rotvec(pose)
    one = simulator.solve(Pose((0, 0, 0), turn.as_quat()))
    two = simulator.solve(Pose((0, 0, 0), (turn * Rotation.from_rotvec([roll, 0, 0])).as_quat()))
    np.testing.assert_allclose(two.positions, one.positions, atol=1e-9)
