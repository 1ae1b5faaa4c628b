# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of many rods at once are those that each rod's own simulator gives, bit for bit."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from wires import copper_wire

from dlo_planner import (
    Capsule,
    DirectSimulator,
    InvalidTask,
    PointLoad,
    Pose,
    Rod,
    parallel,
    solve_many,
)
from dlo_planner.direct.free_loop import free_rods
from dlo_planner.results import Shapes

FIGURES = ('positions', 'frames', 'element_strains', 'gripper_wrench', 'energy', 'elastic_energy',
           'dissipated', 'residual', 'stability', 'violation', 'iterations', 'converged', 'jumped')
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


def spread_rods(count, lengths=False):
    """Return Rods that differ in all that is the same along a DLO."""
    rng = np.random.default_rng(3)
    return [Rod(rng.uniform(0.8, 1.2) if lengths else 1.0, rng.uniform(0.005, 0.02),
                tuple(rng.uniform(0.004, 0.008, 2)), rng.uniform(0.003, 0.006),
                natural_curvature=tuple(rng.normal(0, 0.3, 2)), natural_twist=rng.normal(0, 0.3),
                tip_mass=rng.uniform(0, 0.01), point_masses=((0.53, 0.004),) * (k % 2))
            for k in range(count)]


def poses(count):
    rng = np.random.default_rng(7)
    return [Pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(count)]


def assert_same(simulator, shapes, rods, grippers):
    assert len(shapes) == len(rods)
    for k, (rod, gripper) in enumerate(zip(rods, grippers, strict=True)):
        alone = simulator.with_rod(rod).solve(gripper)
        one = shapes[k]
        s = one.s
        np.testing.assert_array_equal(s[-1], rod.length)
        assert one.gripper == alone.gripper and one.contacts == alone.contacts
        if np.array_equal(s, alone.s):
            for name in FIGURES:
                np.testing.assert_array_equal(getattr(one, name), getattr(alone, name), name)
        else:  # on a finer mesh
            np.testing.assert_array_equal(one.positions, alone.positions_at(s))


@pytest.mark.every(4)
@pytest.mark.parametrize('options', [
    {'n_elements': 32, 'basis': 'local'}, {'n_elements': 32},
    {'n_elements': 16, 'load': (0.02, 0.01, 0.0)}, {}, {'accuracy': 1e-5}])
@pytest.mark.parametrize('lengths', [False, True])
def test_each_rod_is_solved_as_its_own_simulator_does(options, lengths):
    simulator = DirectSimulator(Rod(1.0, 0.01, 0.006, 0.004), **options)
    rods, grippers = spread_rods(9, lengths), poses(9)
    shapes = solve_many(simulator, grippers, rods=rods)
    assert shapes.converged.all()
    assert shapes.s.ndim == 1 + lengths
    assert_same(simulator, shapes, rods, grippers)


def test_one_pose_serves_all_rods():
    simulator = DirectSimulator(copper_wire(), n_elements=16)
    rods = spread_rods(5)
    shapes = solve_many(simulator, LEVEL, rods=rods)
    assert_same(simulator, shapes, rods, [LEVEL] * 5)
    assert solve_many(simulator, [LEVEL], rods=rods) == shapes
    assert len(solve_many(simulator, LEVEL, rods=[])) == 0


def test_an_executor_changes_nothing():
    simulator = DirectSimulator(Rod(1.0, 0.01, 0.006, 0.004), n_elements=16)
    rods, grippers = spread_rods(11, True), poses(11)
    shapes = solve_many(simulator, grippers, rods=rods)
    assert parallel.map(simulator, grippers, rods=rods, chunk=3) == shapes
    with ThreadPoolExecutor(2) as executor:
        assert parallel.map(simulator, grippers, executor, rods=rods, chunk=4) == shapes


def test_rods_that_vary_yield_or_have_nodes_are_solved_too():
    simulator = DirectSimulator(copper_wire(), n_elements=16, basis='local')
    wire = copper_wire()
    rods = [wire, copper_wire(yield_stress=60e6, hardening=0.01), replace(wire, nodes=(0.31,)),
            replace(wire, natural_curvature=(0.0, ((0.0, 0.0), (1.0, 0.5)))),
            replace(wire, point_masses=((0.5, 0.01),))]
    shapes = solve_many(simulator, LEVEL, rods=rods)
    assert_same(simulator, shapes, rods, [LEVEL] * 5)
    # a simulator whose own rod yields takes others all the same
    yielding = DirectSimulator(rods[1], n_elements=16, basis='local')
    assert_same(yielding, solve_many(yielding, LEVEL, rods=rods), rods, [LEVEL] * 5)


@pytest.mark.parametrize('options', [
    {'obstacles': [Capsule((0.3, -0.5, 0.98), (0.3, 0.5, 0.98), 0.02)]}, {'grip': 'pinned'},
    {'point_loads': [PointLoad((0.0, 0.01, 0.0), s=0.4)]}, {'method': 'dfp', 'n_terms': 3}])
def test_what_does_not_hang_freely_is_solved_too(options):
    simulator = DirectSimulator(copper_wire(), n_elements=16, **options)
    rods = [copper_wire(), replace(copper_wire(), tip_mass=0.002)]
    shapes = solve_many(simulator, LEVEL, rods=rods)
    assert_same(simulator, shapes, rods, [LEVEL] * 2)
    assert bool(len(shapes.contact_table)) == ('obstacles' in options)


def test_shapes_of_several_lengths_are_taken_apart_and_joined():
    simulator = DirectSimulator(Rod(1.0, 0.01, 0.006, 0.004), n_elements=8)
    shapes = solve_many(simulator, LEVEL, rods=spread_rods(4, True))
    assert Shapes.joined([shapes[:1], shapes[1:]]) == shapes
    assert [one.s[-1] for one in shapes] == [one.s[-1] for one in shapes[::-1]][::-1]
    same = solve_many(simulator, LEVEL, rods=[replace(one, length=0.7) for one in spread_rods(3)])
    assert same.s.shape == (9,) and same.s[-1] == 0.7
    assert len(Shapes.joined([shapes, same])) == 7
    with pytest.raises(InvalidTask, match='expected the nodes'):
        Shapes.joined([shapes, solve_many(DirectSimulator(copper_wire(), n_elements=9), [LEVEL])])


def test_what_does_not_fit_together_is_refused():
    simulator = DirectSimulator(copper_wire(), n_elements=8)
    rods = spread_rods(3)
    with pytest.raises(InvalidTask, match='2 entries: expected one Pose for each of 3'):
        solve_many(simulator, [LEVEL] * 2, rods=rods)
    with pytest.raises(InvalidTask, match='rods has 3 entries: expected one Rod for each of 2'):
        parallel.map(simulator, [LEVEL] * 2, rods=rods)
    with pytest.raises(InvalidTask, match='expected none where work has motions'):
        parallel.map(simulator, [[LEVEL] * 2], rods=rods)
    loaded = DirectSimulator(copper_wire(), n_elements=8, point_loads=[PointLoad((0, 0, 1), s=0.9)])
    with pytest.raises(InvalidTask, match='PointLoad.s = 0.9'):
        solve_many(loaded, LEVEL, rods=[replace(rods[0], length=0.8)])


def test_each_rod_is_judged_by_its_own_twist():
    # the accuracy of what the loop finds is sure for rods with little natural twist alone
    base = Rod(1.0, 0.01, (0.005, 0.02), 0.01, natural_curvature=(0.2, 0.1))
    twists = np.array([0.0, 14.0, 0.3, -9.0, 25.0, 1.0])
    rods = [replace(base, natural_twist=twist) for twist in twists]
    for rod in (base, rods[1]):  # whichever rod the simulator has
        simulator = DirectSimulator(rod, accuracy=0.05)
        _, sure = free_rods(simulator, rods, np.zeros((6, 3)), np.tile(np.eye(3), (6, 1, 1)))
        np.testing.assert_array_equal(sure, np.abs(twists) < np.pi)


def test_a_load_at_the_end_of_a_shorter_rod_is_at_its_end():
    rods = [copper_wire(), replace(copper_wire(), length=0.98)]
    simulator = DirectSimulator(rods[0], n_elements=16, point_loads=[PointLoad((0, 0, -0.01),
                                                                               s=1.0)])
    found = solve_many(simulator, [LEVEL, LEVEL], rods=rods)
    for k, rod in enumerate(rods):
        np.testing.assert_array_equal(found[k].positions,
                                      simulator.with_rod(rod).solve(LEVEL).positions)
