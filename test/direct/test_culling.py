# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What may act and does not: the answers of all that acts, by the way of a DLO that hangs freely.

Each case is computed twice: as it is, and as if something acted in each step, by the solvers for
obstacles and yielding.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, CutOut, DirectSimulator, Plane, Pose, Rod, Sheet
from dlo_planner.direct import statics
from dlo_planner.direct.boundary_motion import BoundaryMotion, GripTrajectory
from dlo_planner.direct.discretization import Memory
from dlo_planner.direct.integrator import Scheme
from dlo_planner.direct.stepper import Acceptance, Stepper

UP = (0, 0, 1)
HOLE = CutOut(Pose.looking_along((0.9, -0.6, 0.8), (1, 0, 0)), radius=0.02)


def wire(**more):
    return Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, **more)


def turned(degrees, x=0.0, z=1.0):
    return Pose((x, 0, z), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def simulator(around, **options):
    options = {'n_elements': 32, 'basis': 'local'} | options
    return DirectSimulator(around.get('rod', wire()), obstacles=around.get('obstacles', ()),
                           **options)


IDLE = {
    'floor': {'obstacles': [Plane((0, 0, 0.2), UP, 0.3)]},
    'far': {'obstacles': [Plane((0, 0, -50), UP)]},
    'sheet': {'obstacles': [Sheet.around(HOLE)]},
    'box': {'obstacles': [Box(Pose((0.2, 0.5, 0.5), (0, 0, 0, 1)), (0.2, 0.2, 0.2))]},
    'ideal': {'rod': wire(yield_curvature=10.0, section_model='ideal')},
    'fibers': {'rod': wire(yield_curvature=10.0, yield_torsion=5.0, hardening=0.1)},
    'rectangular': {'rod': Rod.rectangular(1.0, 2e-3, 1e-3, 8960.0, 110e9, 0.34),
                    'obstacles': [Plane((0, 0, 0.1), UP)]},
}
BELOW = {'obstacles': [Plane((0, 0, 0.4), UP, 0.2)]}
SOFT = {'rod': wire(yield_curvature=3.5, hardening=0.1)}


@pytest.fixture
def all_acts(monkeypatch):
    """Return a function that makes the call of another with all that may act."""
    def call(function):
        with monkeypatch.context() as patch:
            patch.setattr(Memory, 'idle', False)
            patch.setattr(Stepper, 'hangs_from', lambda stepper, now: False)
            return function()
    return call


@pytest.fixture
def free_alone(monkeypatch):
    """Have it fail where a step is made with all that may act."""
    of_statics, refused = statics._strategies, 'the step was made with what does not act'

    def free(*arguments):
        assert arguments[-1], refused
        return of_statics(*arguments)

    of_stepper = Stepper._batch

    def batch(stepper, *arguments):
        assert arguments[-1], refused
        return of_stepper(stepper, *arguments)

    monkeypatch.setattr(statics, '_strategies', free)
    monkeypatch.setattr(Stepper, '_batch', batch)


def assert_same(one, other, within=1e-9):
    """Assert that two Shapes are the same answer."""
    assert np.abs(one.positions - other.positions).max() < within
    assert np.abs(one.frames - other.frames).max() < 100 * within
    assert np.abs(one.gripper_wrench - other.gripper_wrench).max() < 100 * within
    for name in ('energy', 'elastic_energy', 'violation', 'dissipated', 'far_wrench'):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6,
                                   atol=10 * within)
    assert one.stability == pytest.approx(other.stability, 1e-3, 1e-6)
    assert (one.converged, one.jumped, one.status[:9]) == (
        other.converged, other.jumped, other.status[:9])
    assert len(one.contacts) == len(other.contacts)
    for name, array in other.history.packed().items():
        np.testing.assert_allclose(one.history.packed()[name], array, rtol=1e-6, atol=1e-7)
    assert np.abs(one.history.positions - other.history.positions).max() < within
    assert np.abs(one.history.tangents - other.history.tangents).max() < 100 * within
    assert one.mesh.surroundings == other.mesh.surroundings


@pytest.mark.every(4)
@pytest.mark.parametrize('around', IDLE.values(), ids=IDLE)
@pytest.mark.parametrize('options', [{}, {'basis': 'chebyshev'}], ids=['local', 'chebyshev'])
def test_steps_are_the_same(around, options, all_acts):
    direct = simulator(around, **options)

    def shapes():
        begin = direct.solve(turned(10))
        return [begin, direct.solve(turned(20), begin), *direct.track(map(turned, (0, 5, 12)))]

    for one, other in zip(shapes(), all_acts(shapes), strict=True):
        assert_same(one, other)
        assert one.converged
        assert np.isclose(one.error_estimate, other.error_estimate, rtol=1e-2, atol=1e-9)


@pytest.mark.parametrize('around', IDLE.values(), ids=IDLE)
def test_steps_are_made_without_what_does_not_act(around, free_alone):
    direct = simulator(around)
    rod = replace(direct.rod, yield_curvature=None, yield_torsion=None)
    shape = direct.solve(turned(10), simulator({'rod': rod}).solve(turned(10)))
    assert direct.solve(turned(14), shape).converged
    assert all(shape.converged for shape in direct.track(map(turned, (12, 14)), initial=shape))
    assert len(direct.simulate([turned(10)] * 3, 0.01, shape)) == 3


@pytest.mark.parametrize('around', [IDLE['floor'], IDLE['fibers']], ids=['floor', 'fibers'])
def test_held_far_ends(around, all_acts, free_alone, monkeypatch):
    direct = simulator(around)
    ends = [Pose((0.8, 0, z), (0, 0, 0, 1)) for z in (1.0, 0.99, 0.98)]
    begin = simulator({'rod': wire()}).solve(turned(0), far_end=ends[0])
    shapes = direct.track([turned(0)] * 3, initial=begin, far_ends=ends)
    monkeypatch.undo()
    for one, other in zip(shapes, all_acts(lambda: direct.track(
            [turned(0)] * 3, initial=begin, far_ends=ends)), strict=True):
        assert_same(one, other, 1e-8)
        assert one.far_wrench.any()


@pytest.mark.parametrize('around', IDLE.values(), ids=IDLE)
def test_motions_are_the_same(around, all_acts):
    direct = simulator(around)
    poses = [turned(0, 0.1 * np.sin(0.1 * k) ** 2) for k in range(9)]
    one, other = direct.simulate(poses, 0.01), all_acts(lambda: direct.simulate(poses, 0.01))
    assert one.status == other.status == 'complete'
    for name in ('velocities', 'kinetic_energy', 'potential_energy', 'work', 'losses'):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-6)
    for ours, theirs in zip(one.shapes, other.shapes, strict=True):
        assert np.abs(ours.positions - theirs.positions).max() < 1e-8
        assert np.abs(ours.history.positions - theirs.history.positions).max() < 1e-8


def test_a_track_comes_down_on_a_floor(all_acts):
    direct = simulator(BELOW)
    poses = [turned(0, z=z) for z in (1.3, 1.2, 1.1, 1.05, 1.1, 1.3, 1.4)]
    shapes, known = direct.track(poses), all_acts(lambda: direct.track(poses))
    assert [bool(shape.contacts) for shape in shapes][::3] == [False, True, False]
    for one, other in zip(shapes, known, strict=True):
        assert_same(one, other, 1e-7)


def test_a_track_yields_and_stays_bent(all_acts):
    direct = simulator(SOFT)
    poses = [turned(degrees) for degrees in (-80, -60, -30, 0, -40, -80)]
    shapes, known = direct.track(poses), all_acts(lambda: direct.track(poses))
    assert shapes[0].dissipated == 0 < shapes[3].dissipated == pytest.approx(shapes[-1].dissipated)
    for one, other in zip(shapes, known, strict=True):
        assert_same(one, other, 1e-7)


@pytest.mark.parametrize('around', [BELOW, SOFT], ids=['floor', 'yield'])
def test_a_motion_reaches_what_acts(around, all_acts):
    direct = simulator(around)
    poses = [turned(-70 + 70 * np.sin(0.2 * k) ** 2, z=1.5 - 0.32 * np.sin(0.2 * k) ** 2)
             for k in range(16)]  # there and back
    first = direct.solve(poses[0])
    one = direct.simulate(poses, 0.02, first)
    other = all_acts(lambda: direct.simulate(poses, 0.02, first))
    assert one.status == other.status == 'complete'
    assert not one.shapes[1].contacts and not one.shapes[1].dissipated
    assert one.losses[-1, 1:].max() > 1e-3  # it may bear between two instants alone
    for ours, theirs in zip(one.shapes, other.shapes, strict=True):
        assert np.abs(ours.positions - theirs.positions).max() < 1e-6
        assert len(ours.contacts) == len(theirs.contacts)
    np.testing.assert_allclose(one.losses, other.losses, atol=1e-7)


@pytest.mark.sweep
def test_nothing_is_passed_between_two_poses(all_acts):
    """A bar of 2 mm lies between the wire before the step and where it would hang after it."""
    bar = {'obstacles': [Capsule((0.3, -0.5, 0.86), (0.3, 0.5, 0.86), 1e-3)]}
    direct, free = simulator(bar), simulator({})
    before, after = turned(40), turned(-20)
    begin, beyond = free.solve(before), free.solve(after)
    assert begin.frame_at(0.35)[1][2] > 0.9 and beyond.positions[8:14, 2].max() < 0.85

    def shapes():
        known = direct.solve(before, begin)
        return [known, direct.solve(after, known), direct.track([before, after])[-1],
                direct.solve(after)]

    found = shapes()
    for one, other in zip(found, all_acts(shapes), strict=True):
        assert_same(one, other)
    assert all(shape.contacts or not shape.converged for shape in found[1:])


def test_nothing_is_passed_in_a_motion(all_acts):
    """The gripper comes down by 0.4 m in 0.1 s, 7 ms a step, over a bar of 2 mm."""
    direct = simulator({'obstacles': [Capsule((0.3, -0.5, 0.9), (0.3, 0.5, 0.9), 1e-3)]})
    poses = [turned(0, z=1.2 - 0.4 * np.sin(0.1 * k) ** 2) for k in range(16)]
    one = direct.simulate(poses, 0.007, tolerance=np.inf)
    other = all_acts(lambda: direct.simulate(poses, 0.007, tolerance=np.inf))
    assert not one.shapes[1].contacts and one.shapes[-1].contacts
    for ours, theirs in zip(one.shapes, other.shapes, strict=True):
        assert np.abs(ours.positions - theirs.positions).max() < 1e-6
        assert [contact.obstacle for contact in ours.contacts] == [
            contact.obstacle for contact in theirs.contacts]


def test_what_is_remembered_acts(all_acts):
    """Contact forces and a set of the shape before count, however far what acted is now."""
    direct = simulator(SOFT)
    bent = direct.track([turned(0)])[0]
    assert bent.dissipated > 0
    shape = direct.solve(turned(-80), bent)
    assert shape.history.plastic.any()
    assert_same(shape, all_acts(lambda: direct.solve(turned(-80), bent)))
    still = direct.simulate([turned(-80)] * 3, 0.01, shape)
    assert np.abs(still.shapes[-1].positions - shape.positions).max() < 1e-8
    hung = direct.with_set(bent).solve(turned(-80))
    assert hung.history.plastic.any()


def test_steps_without_what_may_act_leave_nothing_of_it(monkeypatch):
    direct = simulator(SOFT)
    start = direct.solve(turned(-70, z=1.5))
    stepper = Stepper(start.mesh, BoundaryMotion(GripTrajectory([start.gripper] * 3, 0.01)), 0.01)
    with monkeypatch.context() as patch:  # what nobody fills has to be seen
        patch.setattr(np, 'empty', lambda shape, dtype=float: np.full(
            shape, np.nan if dtype is float else 7, dtype))
        now = stepper.begin(start)
        batch = stepper.steps(now, (), np.array([1.0, 2.0]), Scheme('paper', 0.01), Acceptance())
    assert batch.refused is None and batch.last.free
    assert batch.last.row.plastic.size and not batch.last.row.plastic.any()
    assert not batch.last.row.node_forces.any()
