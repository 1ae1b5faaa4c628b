# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Insertion into a bore, and the force that it takes."""

from dataclasses import replace

import numpy as np
import pytest
from references.kirchhoff import true_rod
from scipy.optimize import lsq_linear
from sweeps.cutouts import MESHES, inserted, largest_step, random_bore

from dlo_planner import (
    CutOut,
    DirectSimulator,
    FarEnd,
    Infeasible,
    Insert,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
    Sphere,
    replay,
)
from dlo_planner.inverse.continuation import Step
from dlo_planner.inverse.tasks.insert import Insertion
from dlo_planner.plan.bore import Inside, _inside, pushing
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
RODS = {'round': WIRE,
        'bent': Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.6, 0.4), natural_twist=0.3),
        'weighted': Rod(1.0, 0.05, (0.3, 0.6), 0.25, tip_mass=0.05, point_masses=((0.7, 0.02),))}
BORE = CutOut(Pose.looking_along((0.1, 0, 1), (1, 0.2, 0)))
DEPTHS = np.linspace(0, 0.95, 8)


@pytest.mark.parametrize('name', ['round', 'bent'])
def test_a_uniform_dlo_follows_its_first_shape(name):
    direct = DirectSimulator(RODS[name], accuracy=1e-7)
    inverse = InverseSimulator(direct)
    plan = inverse.insert(BORE, depths=DEPTHS)
    curve = direct.solve(plan.grippers[0], inverse.thread(BORE, depths=[0.0]).shapes[0])
    for depth, gripper in zip(DEPTHS, plan.grippers, strict=True):
        on = curve.at(depth)
        assert np.linalg.norm(on.position - gripper.position) < 1e-6
        np.testing.assert_allclose(on.rotation, gripper.rotation, atol=1e-5)
    threading = inverse.thread(BORE, depths=DEPTHS)  # begins alike, and goes another way
    np.testing.assert_allclose(threading.grippers[0].matrix, plan.grippers[0].matrix, atol=1e-6)
    apart = [np.linalg.norm(a.position - b.position)
             for a, b in zip(threading.grippers, plan.grippers, strict=True)]
    assert max(apart) > 0.05


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('name', RODS)
def test_the_mouth_bears_nothing(name, basis):
    rod = RODS[name]
    direct = DirectSimulator(rod, basis=basis)
    plan = InverseSimulator(direct).insert(BORE, depths=DEPTHS)
    assert plan.fraction == 1 and plan.stability.min() > 0
    assert set(DEPTHS) <= set(plan.depths)
    for depth, gripper, shape in zip(plan.depths, plan.grippers, plan.shapes, strict=True):
        if np.abs(shape.far_wrench).max() > 1e-6:
            continue  # the entrance takes over a mass: another test
        # a DLO cut off at the entrance, with nothing to hold it there
        masses = [(s, m) for s, m in rod.point_masses if s <= 1 - depth]
        cut = Rod(1 - depth, rod.mass_per_length, rod.bending_stiffness, rod.torsional_stiffness,
                  rod.natural_curvature, rod.natural_twist, masses,
                  0.0 if depth else rod.tip_mass)
        end = DirectSimulator(cut, basis=basis).solve(gripper, shape).at(1 - depth)
        assert np.linalg.norm(end.position - BORE.center) < 1e-7
        assert np.linalg.norm(np.cross(end.direction, BORE.normal)) < 1e-6
    bears = np.array([np.abs(shape.far_wrench).max() for shape in plan.shapes])
    assert (bears > 1e-6).any() == (name == 'weighted')
    asked = np.isin(plan.depths, DEPTHS) & (plan.depths > 0)
    assert bears[asked].max() < 1e-6
    report = replay(direct, plan)
    assert report.converged and report.position_error < 1e-6 and report.misalignment < 1e-6


def test_refused_and_named():
    soft = InverseSimulator(DirectSimulator(Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)))
    with pytest.raises(Infeasible) as caught:
        soft.insert(BORE)
    assert caught.value.waypoint == 0 and caught.value.constraint == 'stability'
    stiff = InverseSimulator(DirectSimulator(WIRE))
    with pytest.raises(InvalidTask, match='bore'):
        stiff.insert(3)
    with pytest.raises(InvalidTask, match=r'depths\[1\]'):
        stiff.insert(BORE, depths=[0, 1.0])


def test_a_coarse_series_ends_along_the_bore_all_the_same():
    direct = DirectSimulator(RODS['bent'], basis='fourier', n_elements=64, n_terms=8)
    plan = InverseSimulator(direct).insert(BORE, depths=[0.0, 0.3])
    assert max(np.linalg.norm(one.tangents[-1] - BORE.normal) for one in plan.shapes) < 1e-8


def test_a_strip_that_slides_out_of_the_mouth_is_not_inserted():
    # free of force at the entrance it is not stable with 1 m outside, and the bore lets it slide
    strip = Rod(1.1, 0.04, (0.006, 25.0), 0.009)
    inverse = InverseSimulator(DirectSimulator(strip, basis='local', n_elements=48))
    with pytest.raises(Infeasible, match='fall out') as refused:
        inverse.insert(BORE, depths=np.linspace(0.1, 0.5, 6))
    assert refused.value.waypoint == 0 and refused.value.amount > 0.1
    plan = inverse.insert(BORE, depths=np.linspace(0.2, 0.5, 6))
    ends = [shape.positions[-1] for shape in plan.shapes]
    np.testing.assert_allclose(ends, np.tile(BORE.center, (6, 1)), atol=1e-9)


def test_the_bore_straightens_what_is_bent():
    rod = RODS['bent']
    direct = DirectSimulator(rod, basis='local')
    plan = InverseSimulator(direct).insert(BORE, depths=[0.0, 0.4, 0.7])
    assert np.isnan(plan.bore_moment[0]).all()  # nothing is inside
    for depth, shape, moment in zip(plan.depths[1:], plan.shapes[1:], plan.bore_moment[1:],
                                    strict=True):
        entrance = Pose.from_rotation(BORE.center, shape.frames[-1])
        # the part inside alone, with no weight, both ends held so that it is straight
        inside = Rod(depth, rod.mass_per_length, rod.bending_stiffness, rod.torsional_stiffness,
                     rod.natural_curvature)
        far = Pose.from_rotation(BORE.center + depth * entrance.direction, entrance.rotation)
        straight = DirectSimulator(inside, basis='local', gravity=(0, 0, 0)).solve(
            entrance, far_end=FarEnd(far, 'sleeve'))
        assert straight.converged and np.ptp(straight.tangents, axis=0).max() < 1e-8
        np.testing.assert_allclose(moment, straight.gripper_wrench[3:], atol=1e-4)
        assert np.linalg.norm(moment) == pytest.approx(np.hypot(0.3 * 0.6, 0.6 * 0.4))
        assert np.abs(shape.far_wrench).max() < 1e-6  # and what is outside hangs by itself
    straight = InverseSimulator(DirectSimulator(WIRE)).insert(BORE, depths=[0.0, 0.4])
    np.testing.assert_allclose(straight.bore_moment[1], 0)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_the_mouth_takes_over_a_mass_part_by_part(basis):
    rod = RODS['weighted']
    plan = InverseSimulator(DirectSimulator(rod, basis=basis)).insert(BORE, depths=DEPTHS)
    assert (np.diff(plan.depths) >= 0).all()
    for depth, mass in ((0.0, 0.05), (0.3, 0.02)):
        there = np.abs(plan.depths - depth) < 1e-9
        bears = np.array([shape.far_wrench for shape in plan.shapes])[there]
        assert len(bears) >= 3 and (np.diff(bears[:, 2]) > 0).all()
        assert bears[-1, 2] == pytest.approx(9.81 * mass, rel=1e-4)  # in the end all of it
        assert np.abs(bears[:, [0, 1, 3, 4, 5]]).max() < 1e-3 * 9.81 * mass
    assert largest_step(plan) < 0.3  # the depths asked for are 0.14 m apart
    closer = InverseSimulator(DirectSimulator(rod, basis=basis)).insert(
        BORE, depths=np.linspace(0, 0.95, 57))
    assert largest_step(closer) < 0.11


def test_reasons_are_true():
    rod = Rod(1.0, 0.05, 0.4, 0.25)
    with pytest.raises(Infeasible) as caught:  # upright it would fall over
        InverseSimulator(DirectSimulator(Rod(1.0, 0.05, 0.02, 0.02))).insert(
            CutOut(Pose.looking_along((0, 0, 1), (0, 0, 1))))
    assert caught.value.constraint in ('stability', 'start') and caught.value.amount > 0

    def heavier(s):  # a DLO whose mass per length leaps is a smooth task all the same
        return 0.05 if s < 0.5 else 0.15
    plan = InverseSimulator(DirectSimulator(Rod(1.0, heavier, 0.4, 0.25))).insert(
        BORE, depths=DEPTHS)
    assert plan.fraction == 1
    branch = Insertion(DirectSimulator(rod), BORE, np.eye(3), np.array([0.3]))
    found = branch.first()
    builder = PlanBuilder([0.3], PlanChecker((1.0, 1.0)))
    for change, constraint in (({'residual': 1.0, 'converged': False}, 'equilibrium'),
                               ({'stability': -0.2, 'converged': False}, 'stability')):
        poor = found._replace(shape=replace(found.shape, **change))
        error = branch.refusal(builder, None, Step(poor, 0.0))
        assert error.constraint == constraint
    assert error.amount == 0.2


@pytest.mark.sweep
def test_random_insertions_do_not_leap():
    rng = np.random.default_rng(5)
    for how in MESHES[:2]:
        what = inserted(*random_bore(rng), how).what
        assert what == 'inserted' or what.startswith('refused')


def test_a_turn_that_no_step_makes_smaller_is_refused(monkeypatch):
    at, turned = Insertion.at, Pose((0, 0, 0), (np.sin(0.5), 0, 0, np.cos(0.5)))

    def folded(self, before, depth, roll=0.0, final=False):
        found = at(self, before, depth, roll, final)
        return found._replace(shape=replace(found.shape, gripper=found.shape.gripper.compose(
            turned))) if depth > 0.3 else found

    monkeypatch.setattr(Insertion, 'at', folded)
    with pytest.raises(Infeasible, match='would have to jump at depth 0.2997') as refused:
        InverseSimulator(DirectSimulator(WIRE)).insert(BORE, depths=DEPTHS)
    assert (refused.value.waypoint, refused.value.constraint) == (3, 'continuity')


def test_a_mass_that_no_share_takes_over_evenly_ends_in_a_refusal(monkeypatch):
    # the shares were halved without end
    shape = Insertion._shape

    def leaping(self, outside):
        found, turned = shape(self, outside), Pose((0, 0, 0), (np.sin(0.5), 0, 0, np.cos(0.5)))
        light = sum(mass for s, mass in outside.rod.point_masses) < 0.37e-3
        return replace(found, gripper=found.gripper.compose(turned)) if light else found

    monkeypatch.setattr(Insertion, '_shape', leaping)
    weighted = replace(WIRE, point_masses=((0.8 * WIRE.length, 1e-3),))
    with pytest.raises(Infeasible, match='would have to jump'):
        InverseSimulator(DirectSimulator(weighted)).insert(BORE, depths=[0.0, 0.3])


BORE_WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
WEIGHT = BORE_WIRE.mass_per_length * 9.81
INVERSE = InverseSimulator(DirectSimulator(BORE_WIRE, basis='local', n_elements=32))
BORE_DEPTHS = (0.0, 0.3, 0.6)
BENDS, ROOM = 0.03, 1e-3  # N m^2, m


def bore(direction=(1, 0, 0), radius=1.75e-3):
    return CutOut(Pose.looking_along((0, 0, 1), direction), radius=radius)


def beam(length, **more):
    """Return an Inside without weight that nothing outside holds."""
    count = 60
    return Inside(**{'lengths': np.diff(length * np.linspace(0, 1, count + 1) ** 1.5),
                     'stiffness': np.tile(BENDS * np.eye(2), (count, 1, 1)),
                     'natural': np.zeros((count, 2)), 'load': np.zeros((count + 1, 3)),
                     'entrance': 1e-6 * np.eye(4), 'pushed': np.zeros(4), **more})


@pytest.mark.parametrize('couple', [0.02, 0.1, 1.0])
def test_a_couple_at_the_mouth_wedges_a_beam_between_rim_and_wall(couple, rng):
    free = beam(1.0)
    load = np.zeros((61, 3))
    load[1, 1], load[0, 1] = couple / free.lengths[0], -couple / free.lengths[0]
    arm = np.sqrt(6 * BENDS * 2 * ROOM / couple)
    pushes = [pushing(free._replace(load=load + 1e-9 * rng.normal(size=load.shape)),
                      np.full(61, ROOM), 1e-3).force for _ in range(6)]
    assert pushes[0] == pytest.approx(1e-3 * 2 * couple / arm, rel=0.1)
    assert pushes == pytest.approx(6 * [pushes[0]], rel=1e-3)  # whichever nodes bear


@pytest.mark.parametrize('axis', [0, 1])
def test_a_bent_beam_is_held_straight_by_three_forces(axis):
    length, sag = 0.2, 6 * ROOM
    natural = np.zeros((60, 2))
    natural[:, axis] = 8 * sag / length**2
    middle = 48 * BENDS / length**3 * (sag - 2 * ROOM)
    push = pushing(beam(length, natural=natural), np.full(61, ROOM), 1e-3).force
    assert push == pytest.approx(1e-3 * 2 * middle, rel=0.05)


def test_a_level_bore_rubs_by_the_weight_inside():
    for mu in (0.1, 0.3):
        plan = INVERSE.insert(bore(), depths=BORE_DEPTHS, friction=mu)
        assert plan.insertion_force[0] == 0
        shares = plan.insertion_force[1:] / (mu * WEIGHT * plan.depths[1:])
        # the part outside carries a little of what lies lower than the middle of the entrance
        assert (shares > 0.9).all() and (shares < 1.0).all()


def test_weight_along_the_bore_counts():
    mu, down, up = 0.2, np.radians(60), np.radians(20)
    for angle, sign in ((down, -1), (up, 1)):
        direction = (np.cos(angle), 0, sign * np.sin(angle))
        plan = INVERSE.insert(bore(direction), depths=(0.0, 0.4), friction=mu)
        expected = WEIGHT * 0.4 * (mu * np.cos(angle) + sign * np.sin(angle))
        assert plan.insertion_force[1] == pytest.approx(expected, abs=0.1 * mu * WEIGHT * 0.4)


def test_a_tighter_bore_holds_a_bent_wire_with_more_force():
    rod = replace(BORE_WIRE, natural_curvature=(0.0, 1.5))
    inverse = InverseSimulator(DirectSimulator(rod, basis='local', n_elements=32))
    loose, tight = (inverse.insert(bore(radius=BORE_WIRE.radius + room), depths=BORE_DEPTHS,
                                   friction=0.2).insertion_force[-1] for room in (3e-3, 3e-4))
    assert tight > 1.3 * loose > 0.2 * WEIGHT * 0.6


def test_what_is_not_stated_is_not_looked_at_and_named():
    for hole, friction in ((bore(), None), (CutOut(bore().pose), 0.3)):
        plan = INVERSE.insert(hole, depths=BORE_DEPTHS, friction=friction)
        assert np.isnan(plan.insertion_force).all()
        assert set(plan.insertion_status) == {'not looked at'}
        report = replay(INVERSE.simulator, plan)
        assert np.isnan(report.insertion_force) and 'insertion_force' in report.not_looked_at
        row, = (line for line in plan.summary().splitlines() if 'push into the bore' in line)
        assert 'not looked at' in row
    threaded = INVERSE.thread(bore(), depths=np.linspace(0.0, 0.3, 4))
    assert 'push' not in threaded.summary()
    assert 'insertion_force' not in replay(INVERSE.simulator, threaded).not_looked_at
    with pytest.raises(InvalidTask, match='friction = -1'):
        INVERSE.insert(bore(), friction=-1.0)


def test_the_estimate_travels_with_plan_and_report(tmp_path):
    plan = INVERSE.insert(bore(), depths=BORE_DEPTHS, friction=0.3)
    report = replay(INVERSE.simulator, plan)
    assert report.insertion_force == plan.insertion_force.max() > 0
    assert 'insertion_force' not in report.not_looked_at
    plan.save(tmp_path / 'plan.npz')
    np.testing.assert_array_equal(Plan.load(tmp_path / 'plan.npz').insertion_force,
                                  plan.insertion_force)


@pytest.mark.every(2)
@pytest.mark.parametrize('friction', [0.2, 0.3])
def test_a_push_that_presses_the_dlo_against_the_mouth_jams(friction, tmp_path):
    rod = Rod(1.0, 0.05, 0.2, 0.15, radius=0.002, natural_curvature=(1.0, 0.0))
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=1.01 * 0.002)
    inverse = InverseSimulator(DirectSimulator(rod))
    depths = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9])
    plan = inverse.insert(hole, depths=depths, friction=friction)
    assert set(plan.insertion_status) == {'found', 'jams'}  # half of these were nan
    assert all((status == 'found') == np.isfinite(force)
               for force, status in zip(plan.insertion_force, plan.insertion_status, strict=True))
    for force, status, depth, shape in list(zip(plan.insertion_force, plan.insertion_status,
                                                depths, plan.shapes, strict=True))[1:]:
        # by a quadratic program: a push exceeds what rubs only from the force that was found on
        pushes = np.array((0.95 * force, 1.05 * force) if status == 'found' else (1.0, 2.0, 3.0))
        rubs = [_rubbed_by_scipy(inverse.simulator, shape, depth, 2e-5, friction, push)
                for push in pushes]
        assert rubs[0] > pushes[0]
        assert rubs[1] < pushes[1] if status == 'found' else (rubs > pushes).all()
    report = replay(inverse.simulator, plan)
    jams = plan.insertion_status.count('jams')
    assert report.insertion_force == np.nanmax(plan.insertion_force[1:])
    assert f'insertion_force: jams at {jams} of 5 waypoints' in report.not_looked_at
    assert f'(jams at {jams} of 5 waypoints)' in plan.summary()
    plan.save(tmp_path / 'plan.json')
    assert Plan.load(tmp_path / 'plan.json').insertion_status == plan.insertion_status


def _rubbed_by_scipy(simulator, outside, depth, room, friction, push):
    """Return what a beam in one plane rubs, as a quadratic program in dense matrices."""
    inside = _inside(simulator, simulator.rod.length - depth, outside)
    axis = int(np.abs(inside.natural).sum(axis=0).argmax())
    keep, count = [axis, 2 + axis], inside.lengths.size
    assert np.abs(inside.load[:, 2 - axis]).max() < 1e-12
    force, u = np.zeros(count + 1), np.zeros(2 * count + 2)
    for _ in range(60):
        force[0] = push
        stiff, slope = np.zeros((u.size, u.size)), np.zeros(u.size)
        for e, (h, stiffness, natural) in enumerate(zip(
                inside.lengths, inside.stiffness[:, axis, axis], inside.natural[:, axis],
                strict=True)):
            at = slice(2 * e, 2 * e + 4)
            stiff[at, at] += stiffness / h**3 * np.array(
                [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                 [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])
            stiff[at, at] -= force[e + 1] / (30 * h) * np.array(
                [[36, 3 * h, -36, 3 * h], [3 * h, 4 * h**2, -3 * h, -h**2],
                 [-36, -3 * h, 36, -3 * h], [3 * h, -h**2, -3 * h, 4 * h**2]])
            slope[[2 * e + 1, 2 * e + 3]] += stiffness * natural * np.array([1, -1])
        slope[::2] -= inside.load[:, 1 + axis]
        stiff[:2, :2] += inside.entrance[np.ix_(keep, keep)]
        slope[:2] -= (inside.entrance @ inside.pushed)[keep] * push
        # a quadratic program within |deflection| <= room, as least squares in scaled unknowns; of a
        # beam that buckles in steps that are each convex
        size = 1 / np.sqrt(np.diag(stiff))
        scaled, bounds = size[:, None] * stiff * size, np.full(u.size, np.inf)
        bounds[::2] = room / size[::2]
        near = max(0.0, -2 * np.linalg.eigvalsh(scaled)[0])
        half = np.linalg.cholesky(scaled + near * np.eye(u.size))
        for _ in range(200):
            before = u / size
            now = lsq_linear(half.T, np.linalg.solve(half, near * before - size * slope),
                             (-bounds, bounds), 'bvls', tol=1e-15, max_iter=1000).x
            u = size * now
            if not near or np.abs(now - before).max() <= 1e-7 * np.abs(now).max():
                break
        walls = np.where(np.abs(u[::2]) >= (1 - 1e-9) * room, (stiff @ u + slope)[::2], 0.0)
        last = force.copy()
        force = np.cumsum((friction * np.abs(walls) - inside.load[:, 0])[::-1])[::-1]
        if np.abs(force - last)[1:].max() <= 1e-3 * np.abs(force).max():
            return force[0]
    raise AssertionError('not found')


# a soft wire, w L^3/EI = 88, at a bore as wide as eight of its diameters, and as deep as one
SOFT = Rod(1.0, 0.05, 0.05 * 9.81 / 88, 0.8 * 0.05 * 9.81 / 88, radius=4e-3)
WIDE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, -0.9)), radius=34e-3)
OBLIQUELY = np.linspace(0, 8e-3, 6)


@pytest.fixture(scope='module')
def oblique():
    """Return the simulator and the plan of SOFT, which goes obliquely into WIDE."""
    direct = DirectSimulator(SOFT, basis='local', n_elements=64)
    return direct, InverseSimulator(direct).insert(WIDE, depths=OBLIQUELY, friction=0.3)


def test_a_soft_dlo_hangs_obliquely_into_a_bore_that_is_wide_for_its_depth(oblique):
    direct, plan = oblique
    with pytest.raises(Infeasible) as refused:  # along the bore it does not stay
        InverseSimulator(direct).insert(WIDE, depths=OBLIQUELY, max_misalignment=0)
    assert refused.value.constraint == 'stability' and 'obliquely' not in str(refused.value)
    np.testing.assert_array_equal(plan.depths, OBLIQUELY)
    assert 0.5 < plan.misalignment.max() < 1.2 and plan.stability.min() > 0.1
    room = WIDE.radius - SOFT.radius
    assert (plan.clearance > 0).all() and (plan.clearance < room).all()
    assert (plan.margin > 0.2 * room).all()
    # nothing but the gripper holds it; it touches nothing, so nothing rubs
    assert all(not shape.holds and not shape.contacts for shape in plan.shapes)
    assert (plan.insertion_force == 0).all() and set(plan.insertion_status) == {'found'}
    report = replay(direct, plan)
    assert report.converged and report.clearance > 0.9 * plan.clearance.min()


def test_what_is_inside_a_wide_bore_keeps_clear_of_its_walls(oblique):
    _, plan = oblique
    normal, s = WIDE.normal, np.linspace(0.9, 1, 2001)
    around = np.linspace(0, 2 * np.pi, 361)
    _, y, z = np.array(WIDE.pose.rotation).T
    rim = WIDE.radius * (np.cos(around)[:, None] * y + np.sin(around)[:, None] * z)
    for depth, shape, clearance in zip(plan.depths, plan.shapes, plan.clearance, strict=True):
        true = true_rod(SOFT, shape.gripper, shape)  # at the nodes of the shape
        assert np.linalg.norm(true - shape.positions, axis=1).max() < 1e-3 * SOFT.length
        away = shape.positions_at(s) - WIDE.center
        along = away @ normal
        across = np.linalg.norm(away - along[:, None] * normal, axis=1)
        # half of what is inside is in the middle; the tip is as deep as its tilt leaves
        middle = shape.positions_at([1 - 0.5 * depth])[0] - WIDE.center
        np.testing.assert_allclose(middle, 0.5 * depth * normal, atol=1e-7)
        assert along[-1] <= depth + 1e-9
        inside = (along > 0) & (along < OBLIQUELY[-1])
        if inside.any():
            assert WIDE.radius - across[inside].max() - SOFT.radius > clearance - 1e-5
        assert (along[s < 1 - 0.5 * depth - WIDE.radius / 2] < 0).all()
        # what is least is the distance from the circle of the mouth
        away = away[np.abs(along) < WIDE.radius]
        apart = np.linalg.norm(away[:, None] - rim, axis=2).min() - SOFT.radius
        assert clearance == pytest.approx(apart, abs=1e-5)


def test_a_bore_that_is_deep_for_its_width_leaves_no_room_for_a_tilt(oblique):
    direct, _ = oblique
    inverse = InverseSimulator(direct)
    with pytest.raises(Infeasible, match='obliquely: ') as refused:
        inverse.insert(WIDE, depths=np.linspace(0, 0.2, 4))
    assert refused.value.constraint == 'stability'
    tight = CutOut(WIDE.pose, radius=1.1 * SOFT.radius)
    for hole, options in ((tight, {}), (CutOut(WIDE.pose), {}), (WIDE, {'hold_at': 0.05})):
        with pytest.raises(Infeasible) as refused:  # none is looked for
            inverse.insert(hole, depths=np.linspace(0, 0.05, 4), **options)
        assert 'obliquely' not in str(refused.value)
    with pytest.raises(Infeasible):
        inverse.insert(WIDE, depths=OBLIQUELY, max_misalignment=0.1)
    with pytest.raises(InvalidTask, match='max_misalignment = 2: expected'):
        inverse.insert(WIDE, max_misalignment=2)


def test_what_is_in_the_way_of_an_oblique_insertion_refuses_it(oblique):
    direct, plan = oblique
    ball = Sphere(plan.shapes[-1].positions_at([0.5])[0], 0.02, name='lamp')
    with pytest.raises(Infeasible, match='lamp') as refused:
        InverseSimulator(direct.with_obstacles([ball])).insert(WIDE, depths=OBLIQUELY)
    assert refused.value.constraint == 'clearance'


def test_what_is_held_inside_is_not_led_in_obliquely():
    with pytest.raises(InvalidTask, match=r'max_misalignment = 0\.5: expected None or 0'):
        Insert(CutOut(Pose.identity(), radius=0.1), hold_at=0.1, max_misalignment=0.5)
