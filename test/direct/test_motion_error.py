# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Error estimates of motions are the errors, and steps that change length add none of their own."""

import numpy as np
import pytest
from references.planar_motions import LEVEL, rod, tilted
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Plane, Pose, Rod
from dlo_planner.direct import dynamics
from dlo_planner.direct.boundary_motion import Grips, Guide
from dlo_planner.direct.dynamics import Begun, finer_start
from dlo_planner.direct.integrator import Scheme
from dlo_planner.direct.stepper import Limits, Stepper


def lash(damping=0.0, seconds=0.6):
    """Return a soft wire, the poses of a gripper that turns it over, and their dt."""
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, damping=damping)
    times = np.arange(0, seconds + 0.005, 0.01)
    return wire, [tilted(np.pi / 2 * (1 - np.cos(np.pi * t))) for t in times], 0.01


def steps_of(wire, grippers, dt, elements, halvings, change=None):
    """Return the last positions of even steps; at the instant `change` they are renewed."""
    simulator = DirectSimulator(wire, basis='local', n_elements=elements)
    stepper = Stepper(simulator.solve(grippers[0]).mesh, Grips(Guide(grippers, dt)), dt)
    now = stepper.begin(simulator.solve(grippers[0]))
    scheme, parts = Scheme.named('generalized_alpha', dt / 2**halvings), 2**halvings
    for k in range(len(grippers) - 1):
        if k == change:
            now = stepper.renewed(now, scheme.dt)
        batch = stepper.steps(now, (), k + np.arange(1, parts + 1) / parts, scheme, Limits())
        assert batch.refused is None
        now = batch.last
    return now.nodes.position


def true_end(wire, grippers, dt):
    """Return where the nodes of 32 elements end, from ever finer meshes and steps."""
    coarse, fine, long, short = (
        steps_of(wire, grippers, dt, *how)[::how[0] // 32]
        for how in ((128, 4), (256, 4), (64, 4), (64, 5)))
    return fine + (fine - coarse) / 3 + 4 / 3 * (short - long)


@pytest.mark.parametrize('damping', [0.0, 2e-3])
@pytest.mark.parametrize('begins', ['at rest', 'with its shape'])
def test_the_estimate_is_the_error(damping, begins):
    wire, grippers, dt = lash(damping)
    simulator = DirectSimulator(wire)
    initial = None if begins == 'at rest' else simulator.solve(grippers[0])
    motion = simulator.simulate(grippers, dt, initial)
    end = motion.shapes[-1].positions
    off = np.linalg.norm(end[::(len(end) - 1) // 32] - true_end(wire, grippers, dt), axis=1).max()
    assert off > 5e-5
    assert 0.97 * off < motion.error_estimate[-1] < 2 * off


def test_a_given_rest_is_a_rest_for_the_estimate():
    # not one of this simulator's: the straight wire of a place without gravity
    wire = rod(damping=(0.3, 2e-3))
    grippers = [tilted(0.3 * np.sin(0.1 * k)) for k in range(20)]
    bent = rod(natural_curvature=(0.0, 0.8))
    for thing, away in ((wire, {'gravity': (0, 0, 0)}), (bent, {'gravity': (0, 0, -2.0)})):
        known = DirectSimulator(thing, n_elements=16, basis='local', **away).solve(grippers[0])
        motion = DirectSimulator(thing, n_elements=16, basis='local').simulate(grippers, 0.01,
                                                                               known)
        finer = DirectSimulator(thing, n_elements=32, basis='local', **away).solve(grippers[0])
        moved = np.linalg.norm(finer.positions[::2] - known.positions, axis=1).max()
        assert motion.error_estimate[0] == pytest.approx(4 / 3 * moved, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize('damping', [0.0, (0.5, 2e-3)])
def test_what_is_renewed_is_of_second_order(damping):
    wire, grippers, dt = lash(damping, 0.3)
    moved = [np.abs(steps_of(wire, grippers, dt, 24, halvings, 15)
                    - steps_of(wire, grippers, dt, 24, halvings)).max() for halvings in (1, 2, 3)]
    assert moved[0] < 1e-4
    assert np.log2(moved[0] / moved[2]) / 2 == pytest.approx(2.0, abs=0.2)


def test_the_estimate_looks_between_the_instants():
    # turned and back again: most of what is wrong is not where the gripper's poses are given
    motion = DirectSimulator(rod(), n_elements=16, basis='local').simulate(
        [tilted(0.4 * k) for k in (0, 1, 0, 1, 0)], 0.25)
    func, (stepper, begun, plan, trace) = motion._estimate.func, motion._estimate.args
    assert len(trace.samples) == len(plan.steps) > len(motion)
    at_instants = func(stepper, begun, plan, trace._replace(samples=None))
    assert (at_instants <= motion.error_estimate).all()
    assert at_instants[-1] < motion.error_estimate[-1]


@pytest.mark.parametrize('options', [{}, {'basis': 'local', 'n_elements': 24}])
@pytest.mark.parametrize('integrator', ['generalized_alpha', 'paper'])
def test_many_steps_at_once_are_the_same_as_one_by_one(options, integrator, monkeypatch):
    wire = rod(damping=(0.4, 2e-3), natural_curvature=(0.3, 0.2), tip_mass=0.02)
    grippers = [Pose((0.1 * x, 0, 0), Rotation.from_rotvec(x * np.array([0.3, 1, 0.5])).as_quat())
                for x in np.sin(0.2 * np.arange(25)) ** 2]

    def moved():
        return DirectSimulator(wire, **options).simulate(grippers, 0.01, integrator=integrator)
    many = moved()
    monkeypatch.setattr(dynamics, 'MOST', 1)
    single = moved()
    for name in ('kinetic_energy', 'potential_energy', 'work', 'losses', 'velocities'):
        np.testing.assert_allclose(getattr(many, name), getattr(single, name), rtol=0, atol=1e-12)
    for one, other in zip(many.shapes, single.shapes, strict=True):
        np.testing.assert_allclose(one.positions, other.positions, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(one.gripper.rotation, other.gripper.rotation)
        assert one.converged and one.iterations == other.iterations


def test_the_shortest_steps_can_be_halved_for_an_estimate():
    simulator = DirectSimulator(rod(), n_elements=8, n_terms=4)
    motion = simulator.simulate([LEVEL] * 2, 0.01)
    plan = dynamics.Recipe(2, 'generalized_alpha', np.inf, (dynamics.HALVINGS,) * 4096)
    func, (stepper, begun, _, trace) = motion._estimate.func, motion._estimate.args
    estimate = func(stepper, begun, plan, trace._replace(samples=None))
    # a DLO at rest: it is as wrong after 8192 of them as at the beginning
    assert estimate[-1] == pytest.approx(motion.error_estimate[0], rel=1e-3)


def test_a_finer_motion_begins_with_the_geometry_of_its_own_mesh():
    floor = Plane((0, 0, -0.2), (0, 0, 1))  # which it is compared with
    start = DirectSimulator(rod(radius=3e-3), n_elements=16, obstacles=[floor]).solve(LEVEL)
    mesh = start.state.mesh.finer
    finer = finer_start(mesh, Begun(None, start, None))
    np.testing.assert_array_equal(finer.s, mesh.s)
    assert finer.frames.shape == (33, 3, 3) and finer.positions.shape == (33, 3)
    np.testing.assert_allclose(finer.positions[::2], start.positions, atol=1e-3)
