# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All contact forces of a step at once: scaling, laws, and cables that are laid on a table."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, DirectSimulator, Plane, Pose, Rod, Sphere
from dlo_planner.direct.continuation import shape_change
from dlo_planner.direct.statics import StepInputs, step
from dlo_planner.minimize.active_set import rolled_to
from dlo_planner.minimize.contact_solver import _judged, _lowest, _stiffened
from dlo_planner.minimize.contact_table import kkt_residual, with_contacts, with_contacts_of
from dlo_planner.minimize.hessian import assemble, factorize, new_hessian, solve
from dlo_planner.minimize.interior_point import (
    _scaling,
    _to_boundary,
    add_loads,
    exact_step,
    interior_step,
    new_answer,
    put_motions,
    step_laws,
)
from dlo_planner.minimize.quasi_static import (
    _rolled,
    carried,
    loads_on,
    next_shift,
    settle,
    with_bearing,
    with_candidates,
)
from dlo_planner.minimize.semismooth import forces

CABLE = Rod(1.0, 0.035, 1.2e-3, 9e-4, radius=0.0025)  # a USB cable of 5 mm
NONE = np.zeros((0, 6))


def pose(height, pitch=30.0, x=0.0):
    return Pose((x, 0, height), Rotation.from_euler('y', pitch, degrees=True).as_quat())


def laid(friction, heights, elements=64):
    """Return the Shapes of a cable that is lowered on a table."""
    direct = DirectSimulator(CABLE, basis='local', n_elements=elements,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=friction)])
    shapes = [direct.solve(pose(heights[0]))]
    for height in heights[1:]:
        shapes.append(direct.solve(pose(height), shapes[-1]))
    return shapes


def near_a_table(friction, seed=0):
    """Return Problem, Configuration, table and reaction of a cable near a table, not at rest."""
    direct = DirectSimulator(CABLE, basis='local', n_elements=24,
                             obstacles=[Plane((0, 0, -0.05), (0, 0, 1), friction=friction)])
    mesh = direct.mesh
    system = mesh.system(np.eye(3), np.zeros(3), mesh.past(None, None))
    # (it bends downwards and up again, and is curved to the side)
    q = np.random.default_rng(seed).normal(scale=1e-3, size=(24, 3))
    q[:8, 1] += 0.006
    q[8:16, 1] -= 0.006
    state, whole = kkt_residual(system, q)[0], loads_on(system)
    system = with_candidates(system, state, NONE, 0.1, whole, 1.0, 1.0)
    state, _, table, _ = kkt_residual(system, q)
    assert table.gap.size > 3
    return system, state, table


def test_the_scaling_takes_both_points_to_one():
    rng = np.random.default_rng(0)
    for _ in range(50):
        x, z = np.zeros(3), np.zeros(3)
        for point in (x, z):
            point[1:] = rng.normal(size=2)
            point[0] = np.linalg.norm(point[1:]) + rng.exponential(0.1) + 1e-6
        scale, unscale, soft, middle = (*np.empty((3, 3, 3)), np.empty(3))
        _scaling(x, z, 0.4, 1e-3, middle, scale, unscale, soft)
        np.testing.assert_allclose(scale @ middle, x, rtol=1e-7)
        np.testing.assert_allclose(middle, scale @ z, rtol=1e-12)
        np.testing.assert_allclose(scale, scale.T)
        np.testing.assert_allclose(scale @ unscale, np.eye(3), atol=1e-6)
        gives = np.diag([1e-3 / 0.4**2, 1e-3, 1e-3])
        np.testing.assert_allclose(soft @ (unscale @ unscale + gives), np.eye(3), atol=1e-6)


def test_a_spring_of_what_slides_pulls_no_way():
    """Eigenvalues of the scaling may differ by 1e16: none of the spring becomes negative."""
    rng = np.random.default_rng(0)
    for power in (-6, -10, -14, -18):
        for _ in range(20):
            way = rng.normal(size=2)
            size, beyond = np.linalg.norm(way), 1.0 + 10.0**power
            x, z = np.array([size * beyond, *way]), np.array([3 * size * beyond, *(-3 * way)])
            scale, unscale, soft, middle = (*np.empty((3, 3, 3)), np.empty(3))
            _scaling(x, z, 0.5, 1e-6, middle, scale, unscale, soft)
            assert np.isfinite(soft).all()
            assert np.linalg.eigvalsh(soft).min() > -1e-9 * soft.max()
            np.testing.assert_allclose(soft, soft.T)


def test_a_step_ends_at_the_boundary_of_its_cone():
    rng = np.random.default_rng(1)
    inside = shortened = 0
    for _ in range(200):
        x = np.r_[0.0, rng.normal(size=2)]
        x[0] = np.linalg.norm(x[1:]) + rng.exponential()
        step = 3.0 * rng.normal(size=3)
        part = _to_boundary(x, step)
        at = x + np.linspace(0.0, part, 101)[:, None] * step
        room = at[:, 0] - np.linalg.norm(at[:, 1:], axis=1)
        assert 0.0 < part <= 1.0 and room.min() > -1e-9
        if part < 1.0:
            assert room[-1] == pytest.approx(0.0, abs=1e-9)
            shortened += 1
        inside += part == 1.0
    assert inside > 20 and shortened > 20


@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_loads_are_the_transpose_of_motions(friction):
    system, state, table = near_a_table(friction)
    _, shear = forces(table, state)
    laws = step_laws(system, state, table, shear, 1.0, 0)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    rng = np.random.default_rng(2)
    step, force = rng.normal(size=state.q.shape), rng.normal(size=(table.gap.size, 3))
    moved, right = np.zeros((table.gap.size, 3)), np.zeros_like(step)
    put_motions(system, hessian, laws.rows, step, moved)
    add_loads(system, hessian, laws.rows, force, right)
    assert np.sum(right * step) == pytest.approx(np.sum(force * moved), rel=1e-12)


@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_after_a_step_the_laws_hold(friction, shift=100.0):
    """Gaps, forces and slips of the linear step, and its equilibrium, each by its definition."""
    system, state, table = near_a_table(friction)
    _, shear = forces(table, state)
    hessian, answer = new_hessian(system), new_answer(state.q.shape[0], table.gap.size)
    found = np.zeros((table.gap.size, 3))
    laws = step_laws(system, state, table, shear, 1.0, 0)
    # (by itself it falls)
    assert interior_step(system, state, hessian, laws, 0.01, 0.01, 0.05, True, found, answer,
                         np.zeros(0))[0] == -1
    came, more = interior_step(system, state, hessian, laws, 0.01, 0.01, 1e6, True, found, answer,
                               np.zeros(0))
    assert came == 1 and 0.05 < more < 1e4
    assert interior_step(system, state, hessian, laws, shift, 0.01, 1e6, True, found, answer,
                         np.zeros(0)) == (1, shift)
    assemble(system, state, hessian)
    moved = np.zeros_like(found)
    put_motions(system, hessian, laws.rows, answer.step, moved)
    gap, slip = table.gap + moved[:, 0], laws.slid + moved[:, 1:]
    whole = loads_on(system)
    assert gap.min() > -1e-5 and found[:, 0].min() >= 0.0 and found[:, 0].max() > 1e-3 * whole
    assert np.abs(found[:, 0] * gap).max() < 2e-5 * whole  # (contacts give a little)
    size = np.linalg.norm(found[:, 1:], axis=1)
    assert (size <= friction * found[:, 0] * (1 + 1e-9) + 1e-12).all()
    bears = found[:, 0] > 1e-3 * whole
    if friction > 0.0:
        slides = bears & (np.linalg.norm(slip, axis=1) > 1e-4)
        along = np.sum(slip[slides] * found[slides, 1:], axis=1)
        np.testing.assert_allclose(along, -np.linalg.norm(slip[slides], axis=1) * size[slides],
                                   rtol=1e-3)
        np.testing.assert_allclose(size[slides], friction * found[slides, 0], rtol=1e-3)
    # an exact step leaves the forces that they are
    again = np.zeros_like(found)
    assert exact_step(system, state, hessian, laws, shift, 0.01, 1e6, True, again, answer,
                      np.zeros(0)) == (1, shift)
    np.testing.assert_allclose(again[:, 0].sum(), found[:, 0].sum(), rtol=1e-2)


@pytest.mark.parametrize('seed', [2, 25, 26, 27, 45, 47, 54, 56])
def test_slips_that_go_to_and_fro_are_kept_in_the_end(seed):
    """With so much friction no forces are found while |v| follows; then gaps are less exact."""
    system, state, table = near_a_table(2.0, seed)
    _, shear = forces(table, state)
    hessian, answer = new_hessian(system), new_answer(state.q.shape[0], table.gap.size)
    found, laws = np.zeros((table.gap.size, 3)), step_laws(system, state, table, shear, 1.0, 0)
    assert interior_step(system, state, hessian, laws, 1.0, 0.01, 1e6, True, found, answer,
                         np.zeros(0))[0] == 1
    size = np.linalg.norm(found[:, 1:], axis=1)
    assert (size <= 2.0 * found[:, 0] * (1 + 1e-9) + 1e-12).all()


@pytest.mark.parametrize('friction', [0.0, 0.3, 0.8])
def test_an_exact_step_is_found_from_any_forces(friction):
    """Of what bears and slides nothing is known. Laws are kept by their definitions."""
    came = []
    for seed in range(30):
        system, state, table = near_a_table(friction, seed)
        _, shear = forces(table, state)
        hessian, answer = new_hessian(system), new_answer(state.q.shape[0], table.gap.size)
        found, moved = np.zeros((table.gap.size, 3)), np.zeros((table.gap.size, 3))
        laws = step_laws(system, state, table, shear, 1.0, 0)
        came.append(exact_step(system, state, hessian, laws, 100.0, 0.01, 1e6, True, found,
                               answer, np.zeros(0))[0])
        if came[-1] < 1:
            continue
        put_motions(system, hessian, laws.rows, answer.step, moved)
        gives, whole = laws.give * (found - laws.first), loads_on(system)
        gap = laws.gap + moved[:, 0] + gives[:, 0]
        assert gap.min() > -1e-9 and np.abs(gap * found[:, 0]).max() < 1e-9 * whole
        slip, size = laws.slid + moved[:, 1:] + gives[:, 1:], np.linalg.norm(found[:, 1:], axis=1)
        assert (size <= friction * found[:, 0] * (1 + 1e-9) + 1e-12).all()
        way = np.linalg.norm(slip, axis=1)
        slides = (found[:, 0] > 1e-6 * whole) & (way > 1e-9)
        np.testing.assert_allclose(np.sum(slip * found[:, 1:], axis=1)[slides],
                                   -(way * friction * found[:, 0])[slides], rtol=1e-3)
    assert came.count(1) >= 27, came


def test_a_shift_approaches_that_with_which_a_dlo_falls():
    assert next_shift(1.0, 1e-3, 0.0, 1e-4) == pytest.approx(0.1)
    assert next_shift(1e-4, 1e-3, 0.0, 1e-4) == 0.0
    assert 0.5 < next_shift(1.0, 0.1, 0.5, 1e-4) < 1.0
    assert next_shift(1.0, np.inf, 0.5, 1e-4) == 4.0
    assert next_shift(0.0, np.inf, 0.0, 1e-4) > 0.0


def test_a_cable_is_laid_on_a_table_in_few_steps():
    """The steps that took a second each: friction keeps its cone, forces balance, nothing sinks."""
    friction = 0.5
    shapes = laid(friction, np.linspace(0.6, 0.4, 11))
    weight = CABLE.mass_per_length * CABLE.length * 9.81
    for before, shape in zip(shapes, shapes[1:], strict=False):
        assert shape.converged and not shape.jumped, shape.status
        assert shape.iterations < 200
        assert shape.positions[:, 2].min() > CABLE.radius - 1e-6
        up = shape.gripper_wrench[2] + sum(one.vector[2] for one in shape.contacts)
        assert up == pytest.approx(weight, rel=1e-6)
        for one in shape.contacts:
            assert np.linalg.norm(one.friction) <= friction * one.force * (1 + 1e-5) + 1e-9
        assert np.linalg.norm(shape.positions - before.positions, axis=1).max() < 0.1
    assert len(shapes[-1].contacts) > 15


def test_the_same_pose_again_moves_nothing():
    """What sticks does not creep."""
    shapes = laid(0.5, [0.6, 0.58, 0.56])
    again = shapes[-1]
    simulator = DirectSimulator(CABLE, basis='local', n_elements=64,
                                obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.5)])
    for _ in range(5):
        again = simulator.solve(pose(0.56), again)
    np.testing.assert_allclose(again.positions, shapes[-1].positions, atol=1e-6)


def test_a_hose_on_a_floor_has_no_slow_step():
    hose = Rod(2.0, 0.18, 0.25, 0.2, radius=0.01)
    direct = DirectSimulator(hose, basis='local', n_elements=64,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.6)])
    shape = direct.solve(pose(1.0))
    for x, height in [(0.0, 0.6), (0.0, 0.25), (0.06, 0.25), (0.12, 0.25)]:
        shape = direct.solve(pose(height, x=x), shape)
        assert shape.converged, shape.status
        assert shape.positions[:, 2].min() > hose.radius - 1e-5


def test_what_bears_is_given_back_alone():
    system, state, table = near_a_table(0.5)
    given = system.effects.contact.contacts
    firm = with_bearing(system, state.q, given, True)
    assert firm.effects.contact.contacts.node.max() <= table.force.max() + 1e-12


def test_a_cable_over_the_edge_of_a_table():
    box = Box(Pose((-0.3, 0, -0.2), (0, 0, 0, 1)), (0.6, 0.6, 0.4), friction=0.4)
    direct = DirectSimulator(CABLE, basis='local', n_elements=64, obstacles=[box])
    level = Rotation.identity().as_quat()
    shape = direct.solve(Pose((-0.5, 0, 0.12), level))
    for height in (0.08, 0.04, 0.02):
        shape = direct.solve(Pose((-0.5, 0, height), level), shape)
        assert shape.converged, shape.status
    assert shape.contacts


def test_contacts_that_give_let_a_dlo_not_seem_to_fall():
    """What lies on a table is as stable as on springs that do not give, however soft they are."""
    shape = laid(0.5, [0.6, 0.5, 0.45, 0.4])[-1]
    mesh = shape.state.mesh
    system = mesh.system(shape.gripper.rotation, np.array(shape.gripper.position),
                         shape.state.history)
    q = mesh.unknowns(shape.element_strains)
    soft = _stiffened(system, kkt_residual(system, q)[0], 1e-6)
    state = kkt_residual(soft, q)[0]
    seems, _ = _lowest(soft, state, 1e-8, 1e-9)
    stability, _ = _judged(soft, state, 1e-8, 1e-9)
    assert seems < -1e-3 < 1e-3 < stability


def test_a_fall_of_what_lies_on_a_table_is_one_flow():
    """From where it buckles it comes to rest at once: parts of the step used to find nothing."""
    heights = np.linspace(0.6, 0.03, 30)[:13]
    lying = laid(0.5, heights[:-1])[-1]
    direct = DirectSimulator(CABLE, basis='local', n_elements=64,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.5)])
    fallen = direct._taken_by(())(pose(heights[-1]), lying, (), np.inf)
    assert fallen.converged and fallen.state.kicks > 0 and fallen.iterations < 300
    assert shape_change(lying, fallen) > 0.5
    assert fallen.positions[:, 2].min() > CABLE.radius - 1e-6


def moved_from(shape, gripper):
    """Return what `carried` returns where the gripper of a Shape has moved, and the Problem."""
    mesh, past = shape.state.mesh, shape.state.history
    system = mesh.system(gripper.rotation, np.array(gripper.position), past)
    before = np.hstack([past.positions - gripper.position, past.tangents])
    q = mesh.unknowns(shape.element_strains)
    return *carried(system, q, before, np.array(shape.gripper.rotation)), q, system


@pytest.mark.parametrize('way', [(0.0, 0.0, -1.0, 0.0), (-0.6, 0.5, 0.0, 0.0),
                                 (0.0, 0.0, -0.3, 2.0)])
def test_what_lies_is_carried_along_to_first_order(way):
    """Where a gripper has turned and moved, most of what changes is foreseen, with its contacts."""
    shape = laid(0.5, [0.6, 0.56, 0.52, 0.5])[-1]
    direct = DirectSimulator(CABLE, basis='local', n_elements=64,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.5)])
    *shift, turn = way
    for part in (2e-2, 1e-2, 1e-3):
        turned = Rotation.from_euler('y', np.radians(30) + part * turn).as_quat()
        goal = Pose(shape.gripper.position + part * np.array(shift), turned)
        follows, q, _, before, _ = moved_from(shape, goal)
        there = direct._taken_by(())(goal, shape, (), np.inf)
        right = there.state.mesh.unknowns(there.element_strains)
        assert follows and there.converged
        assert np.linalg.norm(q - right) < 0.2 * np.linalg.norm(before - right)


def test_who_has_another_past_is_not_carried():
    shape = laid(0.5, [0.6, 0.56])[-1]
    goal = Pose(np.add(shape.gripper.position, [0, 0, -1e-3]), shape.gripper.quaternion)
    assert moved_from(shape, goal)[0]
    mesh, past = shape.state.mesh, shape.state.history
    system = mesh.system(goal.rotation, np.array(goal.position), past)
    before = np.hstack([past.positions - goal.position, past.tangents])
    other = 1.01 * mesh.unknowns(shape.element_strains)
    assert not carried(system, other, before, np.array(shape.gripper.rotation))[0]


@pytest.mark.parametrize('way', [(-0.02, 0.0), (-0.01, 0.02)])
def test_friction_is_against_the_way_of_what_goes_along(way):
    """A laid cable that its gripper takes along is in balance at once, but rubs the wrong way."""
    direct = DirectSimulator(CABLE, basis='local', n_elements=64,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.5)])
    before = laid(0.5, np.linspace(0.6, 0.2, 21))[-1]
    side = -np.sign(before.positions[-1, 1])  # it may have buckled to either
    for _ in range(2):
        goal = Pose(np.add(before.gripper.position, [way[0], side * way[1], 0.0]),
                    before.gripper.quaternion)
        shape = direct.solve(goal, before)
        assert shape.converged
        slid = 0
        for one in shape.contacts:
            was, now = (each.positions_at([one.s])[0] for each in (before, shape))
            if np.linalg.norm(now - was) > 2e-4:
                slid += 1
                assert one.friction @ (now - was) < -0.8 * np.linalg.norm(one.friction) * (
                    np.linalg.norm(now - was))
                assert np.linalg.norm(one.friction) == pytest.approx(0.5 * one.force, rel=1e-4)
        before = shape
    assert slid > 5


def test_what_goes_along_in_balance_is_not_at_rest():
    """A cable that lies on a table, and has gone along with its gripper, rubs the wrong way."""
    shape = laid(0.5, np.linspace(0.6, 0.5, 6))[-1]
    goal = Pose(np.add(shape.gripper.position, [0.01, 0.02, 0.0]), shape.gripper.quaternion)
    *_, q, system = moved_from(shape, goal)
    past = shape.state.history
    before = np.hstack([past.positions - goal.position, past.tangents])
    # (points inside an element that share a force are chosen anew, which takes them from balance)
    assert settle(system, q, before, 2e-3, 0, np.inf, np.zeros(2))[3] < 2e-3
    _, _, steps, residual, _ = settle(system, q, before, 2e-3, 250, np.inf, np.zeros(2))
    assert steps > 0 and residual < 2e-3


def test_what_falls_is_followed_as_far_as_is_asked():
    """It counts by how much nodes turn; what has turned by more is not found, and has left."""
    shape = laid(0.5, np.linspace(0.6, 0.5, 6))[-1]
    goal = Pose(np.add(shape.gripper.position, [0.01, 0.02, 0.0]), shape.gripper.quaternion)
    *_, q, system = moved_from(shape, goal)
    past = shape.state.history
    before = np.hstack([past.positions - goal.position, past.tangents])
    _, _, all_steps, residual, _ = settle(system, q, before, 1e-5, 250, 1.0, np.zeros(2))
    assert residual < 1e-5
    _, _, steps, residual, _ = settle(system, q, before, 1e-5, 250, 1e-4, np.zeros(2))
    assert residual == np.inf and 0 < steps < all_steps
    mesh = shape.state.mesh
    near, far = (step(mesh, goal, shape, StepInputs(most=most)) for most in (1e-6, np.inf))
    assert not near.converged and near.state.kicks > 0
    assert far.converged and far.state.kicks == 0
    shift = np.linalg.norm(far.positions - shape.positions, axis=1).max()
    assert shift < 0.1  # as its gripper, or a little more


def test_what_is_deep_comes_out_by_the_part_that_is_asked():
    """As grips come to their places: at once it would take forces beyond all bounds."""
    system, state, table = near_a_table(0.5)
    _, shear = forces(table, state)
    deep = table.gap < 0.0
    assert deep.any() and not deep.all()
    laws = step_laws(system, state, table, shear, 0.25, 0)
    np.testing.assert_array_equal(laws.gap, np.where(deep, 0.25 * table.gap, table.gap))


def test_points_that_roll_to_one_place_are_one():
    """Their forces are one force there, and so is their friction."""
    bar = Capsule((0.51, -1, -0.0125 + 1e-4), (0.51, 1, -0.0125 + 1e-4), 0.01, friction=0.5)
    mesh = DirectSimulator(CABLE, basis='local', n_elements=24, obstacles=[bar]).mesh
    system, q = mesh.system(np.eye(3), np.zeros(3), mesh.past(None, None)), np.zeros((24, 3))
    whole = loads_on(system)
    state = kkt_residual(system, q)[0]
    near = with_candidates(system, state, NONE, 0.05, whole, 0.0, 0.0)
    contacts, scene = near.effects.contact.contacts, near.effects.contact.scene
    one = np.flatnonzero(contacts.obstacle >= 0)
    rubs = np.flatnonzero((contacts.obstacle < 0) & (contacts.fraction < 1.0))
    assert one.size == rubs.size == 1
    fraction = contacts.fraction[one[0]]
    two, places = [one[0], one[0], rubs[0], rubs[0]], fraction + np.array([-4e-3, 3e-3] * 2)
    shear = np.zeros((4, 3))
    shear[2:, 1] = 0.1, 0.2
    near = with_contacts(near, with_contacts_of(
        contacts, contacts.element[two], contacts.obstacle[two], np.array([0.3, 0.4, 1.0, 1.0]),
        places, contacts.anchor[two], contacts.normal[two], shear), scene)
    after = with_candidates(near, state, NONE, 0.05, whole, 0.0, 0.0).effects.contact.contacts
    bears = after.obstacle >= 0
    assert after.fraction[bears] == pytest.approx([fraction], abs=1e-6)
    assert after.multiplier[bears] == pytest.approx([0.7])
    assert after.shear[(after.obstacle < 0) & (after.fraction < 1.0)] == pytest.approx(
        np.array([[0.0, 0.3, 0.0]]), abs=1e-9)


@pytest.mark.parametrize('near', [0.05, 1e-3])
def test_what_touches_a_long_element_is_a_candidate(near):
    """Also where both of its nodes are farther away than what counts as near."""
    bar = Capsule((0.45, -1, -0.0045), (0.45, 1, -0.0045), 0.002)
    mesh = DirectSimulator(CABLE, basis='local', n_elements=6, obstacles=[bar]).mesh
    system, q = mesh.system(np.eye(3), np.zeros(3), mesh.past(None, None)), np.zeros((6, 3))
    state = kkt_residual(system, q)[0]
    near = with_candidates(system, state, NONE, near, loads_on(system), 0.0, 0.0)
    contacts = near.effects.contact.contacts
    assert contacts.element == [2]
    assert contacts.fraction == pytest.approx([0.7])


def over_a_bar(turn, friction=0.0):
    """Return Problem and unknowns of a DLO that bends over a bar, and bears on it at one point."""
    q = np.random.default_rng(0).normal(scale=1e-4, size=(24, 3))
    q[:, 1] += 0.003
    away = Sphere((0, 0, 5), 0.1)
    mesh = DirectSimulator(CABLE, basis='local', n_elements=24, obstacles=[away]).mesh
    x, _, z = 0.5 * kkt_residual(mesh.system(np.eye(3), np.zeros(3), mesh.past(None, None)),
                                 q)[0].positions[12:14].sum(axis=0)
    bar = Capsule((x, -1, z - 0.0123), (x, 1, z - 0.0123), 0.01, friction=friction)
    mesh = DirectSimulator(CABLE, basis='local', n_elements=24, obstacles=[bar]).mesh
    system = mesh.system(np.eye(3), np.zeros(3), mesh.past(None, None))
    state, whole = kkt_residual(system, q)[0], loads_on(system)
    near = with_candidates(system, state, NONE, 0.3, whole, 0.0, turn)
    contacts = near.effects.contact.contacts
    inside = np.flatnonzero(contacts.obstacle >= 0)
    assert inside.size == 1 and contacts.fraction[inside[0]] > 0.0  # nothing bears yet
    contacts.multiplier[inside[0]] = 0.5
    return with_candidates(near, state, NONE, 0.3, whole, 0.0, turn), q


@pytest.mark.parametrize('turn', [0.01, 10.0])
def test_a_step_knows_how_a_point_that_bears_alone_rolls(turn):
    """Its gradient changes as its Hessian says; a point that stays has another one."""
    system, q = over_a_bar(turn)
    contacts = system.effects.contact.contacts
    bears = np.flatnonzero((contacts.obstacle >= 0) & (contacts.multiplier > 0.1))
    assert bears.size == 1 and (contacts.fraction[bears[0]] < 0.0) == (turn < 1.0)
    state, hessian = kkt_residual(system, q)[0], new_hessian(system)
    assemble(system, state, hessian)
    factorize(system, hessian, 0.0)
    way = np.random.default_rng(1).normal(size=q.shape)
    way *= 1e-5 / np.abs(way).max()
    change = 0.5 * (kkt_residual(system, q + way)[0].gradient
                    - kkt_residual(system, q - way)[0].gradient)
    found = np.empty_like(q)
    solve(system, hessian, change, found)
    np.testing.assert_allclose(found, way, atol=1e-4 * np.abs(way).max())


def test_friction_goes_along_with_the_point_that_rolls():
    system, q = over_a_bar(0.01, 0.4)
    state, _, table, _ = kkt_residual(system, q)
    bears = np.flatnonzero(table.force > 0.1)
    assert bears.size == 1
    a = bears[0]
    inside, rubbing = table.inside[a], table.rubbing[a]
    turned = q.copy()
    turned[:8, 1] += 1e-3
    there = kkt_residual(system, turned)[0]
    contacts = _rolled(system, table, there).effects.contact.contacts
    at, places = rolled_to(system, there)
    before = system.effects.contact.contacts
    assert abs(places[inside] - table.element[a] - table.fraction[a]) > 1e-3
    assert contacts.element[rubbing] + contacts.fraction[rubbing] == pytest.approx(places[inside])
    others = np.arange(before.element.size) != rubbing
    np.testing.assert_array_equal(contacts.fraction[others], before.fraction[others])
