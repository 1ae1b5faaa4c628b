# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that touches itself: a twisted rod that throws a loop, against what does not depend on it.

What balance, link and the distance of the strands say; Clauvelin, Audoly and Neukirch's
plectonemes are in the registry of validations (`benchmarks/strands.py`).
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Hold,
    InvalidTask,
    Plane,
    PointLoad,
    Pose,
    Rod,
    solve_many,
)
from dlo_planner.direct.self_contact import may_have_met
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import StepInputs, step
from dlo_planner.geometry.writhe import link

LENGTH, RADIUS, EI = 0.6, 0.006, 1.2e-3
ROD = Rod(length=LENGTH, mass_per_length=0.035, bending_stiffness=EI,
          torsional_stiffness=0.8 * EI, radius=RADIUS)
GRIPPER = Pose.looking_along((0, 0, 0), (1, 0, 0))
LAST = 4.25  # turns


def far(turns, x=0.45):
    a = 2 * np.pi * turns
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    return FarEnd(Pose.from_rotation(np.array([x, 0, 0]), GRIPPER.rotation @ about_x))


def simulator(**more):
    return DirectSimulator(ROD, basis='local', n_elements=48, gravity=(0, 0, 0), **more)


def wound(one, step=0.25):
    """Return the shapes as the far end is turned."""
    turns = np.arange(0.0, LAST + 1e-9, step)
    return one.track([GRIPPER] * turns.size, far_ends=[far(turn) for turn in turns])


@pytest.fixture(scope='module')
def shapes():
    """Return the shapes of a rod that throws a loop and touches itself there."""
    return wound(simulator(self_contact=True))


def links(found):
    return [float(link(np.diff(one.s), *(np.array(part) for part in (
        one.element_strains, one.frames, one.positions)), 0.0)) for one in found]


def test_a_twisted_rod_throws_a_loop_that_bears_on_itself(shapes):
    last = shapes[-1]
    assert all(one.converged for one in shapes)
    assert not shapes[4].self_contacts
    assert last.self_contacts
    assert all(one.passed_itself is False for one in shapes)
    assert last.lies_in_itself is False
    assert last.self_distance > 1.98 * RADIUS
    assert last.stability > -1e-6  # it may spin about the line between its grips
    for one in last.self_contacts:
        assert 0 < one.s < one.other_s < LENGTH
        assert one.force > 0
        assert one.penetration < 1e-6 * LENGTH
        assert np.linalg.norm(one.normal) == pytest.approx(1.0)
        place = last.positions_at(np.array([one.s, one.other_s]))
        assert one.normal @ (place[0] - place[1]) == pytest.approx(2 * RADIUS, rel=0.02)


def test_its_link_is_that_of_its_grips(shapes):
    # without contact two turns are lost as it passes through itself
    known = links(shapes)
    np.testing.assert_allclose(np.diff(known), 0.25, atol=0.02)
    lost = wound(simulator())
    assert any(one.passed_itself is not False for one in lost)
    assert links(lost)[-1] < known[-1] - 1.0


def test_a_single_step_does_not_lead_a_loop_through_itself():
    # the tip crosses above the strand at the gripper, and goes below it: parts of the way that are
    # large, and not looked at, take it through that strand, and two turns of the link with it
    one, loop = simulator(self_contact=True), None
    for part in np.linspace(0.3, 1.0, 12):
        angle = 1.5 * np.pi * part
        place = np.array([0.45, 0.35, 0]) + part * np.array([-0.35, -0.45, 0.03])
        loop = one.solve(GRIPPER, loop, far_end=Pose.looking_along(
            place, (np.cos(angle), np.sin(angle), 0)))
    assert loop.converged and loop.passed_itself is False
    for x in (0.04, 0.05, 0.06):
        below = FarEnd(Pose.looking_along((x, -0.05, -0.02), (0, -1, 0)))
        shape = step(one.mesh, GRIPPER, loop, StepInputs(holds=(below,)))
        assert shape.converged
        assert links([shape])[0] == pytest.approx(links([loop])[0], abs=0.1)


def test_forces_balance_and_what_is_inside_agrees_with_its_strains(shapes):
    last = shapes[-1]
    total = last.gripper_wrench[:3] + last.far_wrench[:3]
    assert np.abs(total).max() < 1e-8 * np.abs(last.far_wrench[:3]).max()
    inside = last.section_forces
    assert inside.imbalance < 1e-8
    # moments of the balance against those of the strains, at the middles of the elements
    moments = inside.at_nodes(last.s)[1]
    means = 0.5 * (moments[1:] + moments[:-1])
    stiffness = np.array([0.8 * EI, EI, EI])
    wanted = last.element_strains * stiffness
    assert np.abs(means - wanted).max() < 0.05 * np.abs(wanted).max()


def test_energy_is_least_where_no_strand_is_in_another(shapes):
    # the forces on the strands are the slope of the least energy by their radius
    last, change = shapes[-1], 1e-5
    energies = []
    for radius in (RADIUS - change, RADIUS + change):
        thick = Rod(length=LENGTH, mass_per_length=0.035, bending_stiffness=EI,
                    torsional_stiffness=0.8 * EI, radius=radius)
        one = DirectSimulator(thick, basis='local', n_elements=48, gravity=(0, 0, 0),
                              self_contact=True)
        there = one.solve(GRIPPER, last, far_end=far(LAST))
        assert there.converged
        energies.append(there.energy)
    slope = (energies[1] - energies[0]) / (2 * change)
    assert slope == pytest.approx(2.0 * sum(one.force for one in last.self_contacts), rel=1e-3)


def test_what_is_found_is_kept_in_files(shapes, tmp_path):
    last = shapes[-1]
    last.save(tmp_path / 'loop.npz')
    known = Shape.load(tmp_path / 'loop.npz')
    assert known.self_contacts == last.self_contacts
    assert known.history == last.history


def walk(seed, steps):
    """Return poses of a far end that is turned, led about and tilted at random."""
    rng, turn, place = np.random.default_rng(seed), Rotation.identity(), np.array([0.4, 0, 0])
    place[0] += 0.1 * rng.random()
    twist, poses = Rotation.from_rotvec([0.6 * rng.choice([-1, 1]), 0, 0]), []
    for k in range(steps):
        turn = twist * turn if k else turn
        if k > 3:
            place = place + rng.normal(scale=0.02, size=3)
            turn = Rotation.from_rotvec(rng.normal(scale=0.12, size=3)) * turn
            place = place * min(1.0, 0.5 / np.linalg.norm(place))
        poses.append(Pose.from_rotation(place, turn.as_matrix() @ GRIPPER.rotation))
    return poses


def test_what_falls_does_not_swing_past_the_back_of_a_grip():
    # it did, and lost two turns: it comes to rest on what stands for that grip
    poses = walk(19, 36)
    found = simulator(self_contact=True).track([GRIPPER] * 36, far_ends=[*map(FarEnd, poses)])
    assert all(one.converged for one in found)
    assert all(one.passed_itself is False for one in found)
    assert any(one.jumped for one in found)
    turned = [(np.linalg.norm(Rotation.from_matrix(b.rotation @ a.rotation.T).as_rotvec()))
              for a, b in zip(poses, poses[1:], strict=False)]
    assert (np.abs(np.diff(links(found))) < np.array(turned) / np.pi).all()
    last = found[-1]
    assert any(one.other_s > LENGTH for one in last.self_contacts)
    # the grip has its forces, and moments
    total = last.gripper_wrench + last.far_wrench
    total[3:] += np.cross(last.positions[-1] - last.positions[0], last.far_wrench[:3])
    assert np.abs(total[:3]).max() < 1e-10
    assert np.abs(total[3:]).max() < 1e-4 * np.abs(last.far_wrench[3:]).max()
    assert last.section_forces.imbalance < 1e-8


def test_what_does_not_bend_back_is_as_without():
    poses = [Pose.looking_along((0, 0, 0), (1, 0, z)) for z in (0.0, 0.2, 0.5)]
    one, other = simulator(self_contact=True), simulator()
    for pose in poses:
        np.testing.assert_array_equal(one.solve(pose).positions, other.solve(pose).positions)


def test_what_loses_turns_may_have_met_itself():
    # both are straight: nothing but the turns says that it made a loop on its way
    pulled = DirectSimulator(ROD, basis='local', n_elements=24, gravity=(0, 0, 0),
                             point_loads=[PointLoad((5.0, 0.0, 0.0))], self_contact=True)
    ends = [FarEnd(far(turns, LENGTH).pose, 'sleeve') for turns in (0.0, 0.4, 0.8)]
    first, *_, last = pulled.track([GRIPPER] * 3, far_ends=ends)
    assert first.converged
    assert last.converged
    assert may_have_met(last, first)
    assert not may_have_met(first, first)


def coil(turns):
    return Rod(length=LENGTH, mass_per_length=0.035, bending_stiffness=EI,
               torsional_stiffness=0.8 * EI, radius=RADIUS,
               natural_curvature=(2 * np.pi * turns / LENGTH, 0.0))


def test_many_of_them_are_those_of_one_at_a_time():
    rod = coil(2.5)
    one = DirectSimulator(rod, basis='local', n_elements=48, self_contact=True)
    shape = one.solve(GRIPPER)
    assert shape.converged
    assert shape.self_contacts
    for found in (solve_many(one, GRIPPER, rods=[rod])[0], solve_many(one, [GRIPPER])[0]):
        np.testing.assert_array_equal(found.positions, shape.positions)
        assert found.self_contacts == shape.self_contacts
        assert found.status == shape.status


def test_what_has_no_side_to_go_to_is_no_answer_and_no_error():
    flat = DirectSimulator(coil(2.0), basis='local', n_elements=48, gravity=(0, 0, 0),
                           self_contact=True)
    shape = flat.solve(GRIPPER)
    assert not shape.converged
    assert shape.lies_in_itself is True


def test_places_move_along():
    shape = DirectSimulator(coil(2.5), basis='local', n_elements=48, self_contact=True).solve(
        GRIPPER)
    moved = shape.moved((0, 0, 1))
    assert shape.self_contacts
    for one, other in zip(shape.self_contacts, moved.self_contacts, strict=True):
        np.testing.assert_array_equal(other.position, one.position + [0, 0, 1])


@pytest.mark.parametrize(('more', 'message'), [
    ({'rod': Rod.rectangular(length=1.0, width=0.01, thickness=0.001, youngs_modulus=2e11,
                             density=7850.0, poisson_ratio=0.3)}, 'with a rectangular section'),
    ({'grip': 'pinned'}, "expected False with grip = 'pinned'"),
])
def test_what_it_does_not_go_with_is_refused(more, message):
    with pytest.raises(InvalidTask, match=message):
        DirectSimulator(**{'rod': ROD, 'self_contact': True, **more})


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_a_coil_that_is_let_down_on_a_floor_lies_on_itself(friction):
    floor = Plane((0, 0, 0), (0, 0, 1), friction=friction)
    rod = replace(coil(1.5), natural_curvature=(0.0, 3 * np.pi / LENGTH))
    one, shape = DirectSimulator(rod, basis='local', n_elements=32, obstacles=[floor],
                                 self_contact=True), None
    for z in np.arange(0.12, 0.029, -0.015):
        shape = one.solve(Pose.looking_along((0, 0, z), (1, 0, -0.1)), shape)
        assert shape.converged
        assert shape.passed_itself is False
    assert shape.self_contacts
    assert len(shape.contacts) > 5
    assert shape.lies_in_itself is False
    assert shape.positions[1:, 2].min() > RADIUS * (1 - 1e-4)
    for contact in shape.contacts:
        assert np.linalg.norm(contact.friction) <= friction * contact.force * (1 + 1e-9) + 1e-12
    # what the gripper and the floor bear is the weight
    total = shape.gripper_wrench[:3] + sum(contact.vector for contact in shape.contacts)
    weight = 0.035 * LENGTH * 9.81
    np.testing.assert_allclose(total, [0, 0, weight], atol=1e-6 * weight)
    inside = shape.section_forces
    assert inside.imbalance < 1e-6 * weight
    moments = inside.at_nodes(shape.s)[1]
    wanted = shape.bent * np.array([0.8 * EI, EI, EI])
    assert np.abs(0.5 * (moments[1:] + moments[:-1]) - wanted).max() < 0.05 * np.abs(wanted).max()


def crossing():
    """Return gripper poses that lay the end of a cable across the rest of it, on a floor.

    Its end is led around by three quarters of a circle, over what lies there, let down, and on.
    """
    ways = [(0.0, 0.0, z, 0.0) for z in (0.1, 0.03)]
    ways += [(x, 0.0, 0.03, 0.0) for x in (0.1, 0.22)]
    turns = -np.radians(np.arange(15, 271, 15))
    ways += [(0.22 + 0.12 * np.sin(a), 0.12 - 0.12 * np.cos(a), 0.03, a) for a in turns]
    ways += [(0.34, y, 0.03, turns[-1]) for y in (0.08, 0.04, 0.0, -0.04)]
    ways += [(0.34, -0.04 - 0.01 * k, 0.03 - 0.0055 * k, turns[-1]) for k in range(1, 5)]
    ways += [(0.34, y, 0.008, turns[-1]) for y in (-0.12, -0.16, -0.2, -0.23, -0.26)]
    return [Pose.looking_along(way[:3], (np.cos(way[3]), np.sin(way[3]), 0)) for way in ways]


@pytest.mark.every(2)
@pytest.mark.parametrize('friction', [0.3, 0.0])
def test_a_cable_whose_end_is_laid_across_it_lies_on_itself(friction):
    cable = Rod(length=1.0, mass_per_length=0.035, bending_stiffness=EI,
                torsional_stiffness=0.8 * EI, radius=0.0025)
    one = DirectSimulator(cable, basis='local', n_elements=48, self_contact=True,
                          self_friction=friction,
                          obstacles=(Plane((0, 0, 0), (0, 0, 1), friction=0.5),))
    shapes = one.track(crossing())
    assert all(shape.converged and shape.passed_itself is False for shape in shapes)
    for shape in shapes[-3:]:
        (touch,) = shape.self_contacts
        # what lies across is borne by what it lies on, and this by the floor
        assert touch.normal[2] > 0.9
        below = [c.force for c in shape.contacts if abs(c.s - touch.other_s) < 0.06]
        assert sum(below) > touch.force > 0.05
        assert np.linalg.norm(touch.friction) <= friction * touch.force * (1 + 1e-6)
        assert shape.section_forces.imbalance < 1e-6 * 0.035 * 9.81
        s = np.linspace(0.0, 1.0, 2001)
        places = shape.positions_at(s)
        apart = cdist(places[np.abs(s - touch.s) < 0.04], places[np.abs(s - touch.other_s) < 0.04])
        # (strands are the chords of their elements, which leave the axis by this)
        chord = 0.125 * np.linalg.norm(shape.element_strains[:, 1:], axis=1).max() / 48**2
        assert apart.min() == pytest.approx(0.005, abs=2 * chord)
        # springs bear little at first, and a strand may come to the next element: then a search
        # among obstacles goes on where the one before has ended
        assert shape.iterations < 400


def winding(seconds, n_elements, self_contact, tolerance=None):
    """Return the motion in which a twisted rod throws a loop: its strands meet at 1.52 s."""
    instants = np.arange(0.0, seconds + 1e-3, 0.02)
    one = DirectSimulator(replace(ROD, damping=(0.0, 0.002)), basis='local', gravity=(0, 0, 0),
                          n_elements=n_elements, self_contact=self_contact)
    start = one.track([GRIPPER] * 5, far_ends=[far(k / 4) for k in range(5)])[-1]
    return one.simulate([GRIPPER] * instants.size, 0.02, initial=start, tolerance=tolerance,
                        far_ends=[far(1.0 + 2.0 * time) for time in instants])


@pytest.fixture(scope='module')
def wound_up():
    """Return a motion of strands that bear, and a rough one of strands that do not."""
    return winding(1.6, 48, True), winding(1.56, 32, False, np.inf)


def test_strands_that_hit_each_other_in_a_motion_do_not_pass(wound_up):
    bearing, passing = wound_up
    assert passing.status == 'self-passage'
    assert bearing.status == 'complete'
    turned = 2.0 * (bearing.times - bearing.times[0])
    np.testing.assert_allclose(links(bearing.shapes), 1.0 + turned, atol=1e-6)
    nearest = min(shape.self_distance for shape in bearing.shapes)
    assert 0.95 * 2 * RADIUS < nearest < 1.05 * 2 * RADIUS
    last = bearing.shapes[-1]
    assert last.self_contacts  # by springs, which give
    assert max(one.penetration for one in last.self_contacts) < 0.01 * RADIUS
    assert last.lies_in_itself is False


def test_no_step_of_a_motion_leads_a_strand_through_another():
    # a coil of 1.35 turns, whose end is thrown at its beginning: an even step of 0.03 s would lead
    # it past that, and springs would press it on, on the other side
    radius = LENGTH / (2.7 * np.pi)
    rise = 5 * RADIUS / (2 * np.pi)
    coil = replace(ROD, natural_curvature=(0.0, radius / (radius**2 + rise**2)),
                   natural_twist=rise / (radius**2 + rise**2))
    one = DirectSimulator(coil, basis='local', n_elements=32, gravity=(0, 0, 0), self_contact=True)
    start = one.solve(GRIPPER)
    assert start.self_distance > 4 * RADIUS
    ways = np.diff(start.positions, axis=0)
    axis = np.cross(ways[:-1], ways[1:]).sum(axis=0)
    axis *= -3.0 * np.sign(axis @ start.positions[-1]) / np.linalg.norm(axis)
    motion = one.simulate([GRIPPER] * 3, 0.03, start, velocity=lambda s: axis * s / LENGTH,
                          tolerance=np.inf)
    assert motion.status == 'complete', motion.message
    assert not any(shape.passed_itself for shape in motion.shapes)
    assert min(shape.self_distance for shape in motion.shapes) > 1.9 * RADIUS


def test_a_motion_that_winds_itself_up_gains_no_energy(wound_up):
    motion = wound_up[0]
    moved = motion.kinetic_energy.max()
    assert moved > 1e-3
    assert np.diff(motion.numerical_loss).min() > -2e-3 * moved
    assert motion.numerical_loss[-1] < 0.1 * moved


FRICTION = 0.3


@pytest.fixture(scope='module')
def opened(shapes):
    """Return shapes of a rod that touches itself, drawn out and let in again, with friction."""
    rough, found = simulator(self_contact=True, self_friction=FRICTION), shapes[-1:]
    for x in (*np.arange(0.4525, 0.4651, 0.0025), *np.arange(0.4625, 0.4524, -0.0025)):
        found.append(rough.solve(GRIPPER, found[-1], far_end=far(LAST, x)))
    return found


def test_friction_holds_a_loop_that_opens_and_closes(opened, shapes):
    smooth, last = simulator(self_contact=True), shapes[-1]
    stiffness, slides = np.array([0.8 * EI, EI, EI]), 0
    last = smooth.solve(GRIPPER, last, far_end=far(LAST, 0.4575))
    # as it is drawn out it pulls harder than without friction, as it is let in less
    for shape, sign in ((opened[3], 1.0), (opened[9], -1.0)):
        assert shape.far_end.pose.position[0] == pytest.approx(0.4575)
        assert sign * (shape.far_wrench[0] - last.far_wrench[0]) > 0.05
    for shape in opened[1:]:
        assert shape.converged
        assert shape.passed_itself is False
        for one in shape.self_contacts:
            size = np.linalg.norm(one.friction)
            assert size <= FRICTION * one.force * (1 + 1e-6)
            assert abs(one.friction @ one.normal) < 1e-9
            slides += size > 0.99 * FRICTION * one.force
        total = shape.gripper_wrench + shape.far_wrench
        total[3:] += np.cross(shape.positions[-1] - shape.positions[0], shape.far_wrench[:3])
        assert np.abs(total[:3]).max() < 1e-9
        assert np.abs(total[3:]).max() < 1e-4 * np.abs(shape.far_wrench[3:]).max()
        # moments of the balance, with the couples of friction, against those of the strains
        inside = shape.section_forces
        assert inside.imbalance < 1e-8
        moments = inside.at_nodes(shape.s)[1]
        wanted = shape.element_strains * stiffness
        assert (np.abs(0.5 * (moments[1:] + moments[:-1]) - wanted).max()
                < 0.05 * np.abs(wanted).max())
    assert slides > 5


def test_what_the_grips_lose_is_the_work_of_friction(opened):
    # (steps as small as no step is made in parts, of which the last one alone is told)
    rough, shape = simulator(self_contact=True, self_friction=FRICTION), opened[3]
    work = rubbed = 0.0
    for x in 0.4575 + 3.125e-4 * np.arange(1, 9):
        before, shape = shape, rough.solve(GRIPPER, shape, far_end=far(LAST, x))
        work += 1.5625e-4 * (before.far_wrench[0] + shape.far_wrench[0])
        rubbed += shape.history.friction_work
    assert rubbed > 5e-4
    assert work - (shape.energy - opened[3].energy) == pytest.approx(rubbed, rel=0.01)


def surface(shape, s, way):
    """Return where a point `way` beside the axis at s is, and the frame of the DLO there."""
    e = int(np.clip(np.searchsorted(shape.s, s, side='right') - 1, 0, shape.s.size - 2))
    part = (s - shape.s[e]) / (shape.s[e + 1] - shape.s[e])
    chord = shape.positions[e] + part * (shape.positions[e + 1] - shape.positions[e])
    return chord + way, shape.frames[e]


def test_friction_is_against_the_way_that_surfaces_have_slid(opened):
    seen = 0
    for before, after in zip(opened[1:], opened[2:], strict=False):
        for one in after.self_contacts:
            slip = slipped(before, after, one)
            limit = 0.999 * FRICTION * one.force
            if np.linalg.norm(slip) > 5e-4 and np.linalg.norm(one.friction) > limit:
                seen += 1
                along = -slip @ one.friction / np.linalg.norm(slip) / np.linalg.norm(one.friction)
                assert along > 0.9
    assert seen >= 3


def test_friction_goes_along_in_files_and_in_shapes(opened, tmp_path):
    last = opened[-1]
    assert any(one.friction.any() for one in last.self_contacts)
    last.save(tmp_path / 'loop.npz')
    known = Shape.load(tmp_path / 'loop.npz')
    assert known.self_contacts == last.self_contacts
    assert known.history == last.history
    np.testing.assert_array_equal(known.history.frames, last.frames)


DRAWN = [far(LAST, 0.45 + 0.01 * (t - np.sin(2 * np.pi * t) / (2 * np.pi)))
         for t in np.linspace(0.0, 1.0, 41)]


@pytest.fixture(scope='module')
def drawn(shapes):
    """Return motions in which the loop is drawn out, with friction and without."""
    return tuple(simulator(self_contact=True, self_friction=friction).simulate(
        [GRIPPER] * 41, 0.0125, initial=shapes[-1], far_ends=DRAWN) for friction in (FRICTION, 0.0))


def slipped(before, after, one):
    """Return how far the surfaces at a contact of `after` have slid since `before`, (3,) m."""
    away, turns = np.zeros(3), []
    for s, sign in ((one.s, -1.0), (one.other_s, 1.0)):
        _, now = surface(after, s, 0.0)
        _, then = surface(before, s, 0.0)
        there, _ = surface(before, s, then @ now.T @ (sign * RADIUS * one.normal))
        away -= sign * there
        turns.append(now @ then.T)
    slip = -0.5 * (turns[0] + turns[1]) @ away
    return slip - one.normal * (one.normal @ slip)


def test_what_strands_that_rub_in_a_motion_take_is_the_work_of_coulombs_law(drawn):
    rough, smooth = drawn
    assert rough.status == smooth.status == 'complete'
    rubbed = slides = 0.0
    for before, after in zip(rough.shapes, rough.shapes[1:], strict=False):
        for one in after.self_contacts:
            assert np.linalg.norm(one.friction) <= FRICTION * one.force * (1 + 1e-3)
            assert abs(one.friction @ one.normal) < 1e-9
            if np.linalg.norm(one.friction) > 0.99 * FRICTION * one.force:
                slides += 1
                rubbed += FRICTION * one.force * np.linalg.norm(slipped(before, after, one))
    assert slides > 20
    # by works and energies alone, none of which knows of friction
    missing = rough.work[-1] - (rough.energy[-1] - rough.energy[0])
    assert missing > 5e-4
    assert missing == pytest.approx(rubbed, rel=0.15)
    assert np.diff(rough.numerical_loss).min() > -2e-3 * missing
    # (friction that is limited by forces of the step before takes 1.6 times that)
    assert np.abs(rough.numerical_loss).max() < 1.5e-3 * missing
    assert rough.work[-1] > 1.05 * smooth.work[-1]


def test_the_error_of_a_motion_tells_something_where_strands_bear(drawn):
    for motion in drawn:
        assert np.all(np.diff(motion.error_estimate) >= 0.0)
        assert 1e-4 * LENGTH < motion.error_estimate[0] < 1e-2 * LENGTH
        assert motion.error_estimate[-1] < 0.25 * LENGTH


def test_a_motion_that_goes_on_rubs_as_if_it_had_not_ended(shapes, drawn):
    whole, rough = drawn[0], simulator(self_contact=True, self_friction=FRICTION)
    first = rough.simulate([GRIPPER] * 21, 0.0125, initial=shapes[-1], far_ends=DRAWN[:21])
    then = rough.simulate([GRIPPER] * 4, 0.0125, initial=first, far_ends=DRAWN[20:24])
    assert then.shapes[0].energy == first.shapes[-1].energy
    assert then.energy[0] == pytest.approx(first.energy[-1], rel=1e-7)
    for one, other in zip(then.shapes, whole.shapes[20:], strict=False):
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-3 * RADIUS)
        assert len(one.self_contacts) == len(other.self_contacts) > 1
        for here, there in zip(one.self_contacts, other.self_contacts, strict=True):
            assert np.linalg.norm(there.friction) > 0.05 * there.force
            np.testing.assert_allclose(here.friction, there.friction, atol=2e-3 * there.force)


@pytest.mark.parametrize(('more', 'message'), [
    ({'self_friction': 0.3}, 'self_friction = 0.3: expected 0 without self_contact'),
    ({'self_contact': True, 'self_friction': -0.1}, 'self_friction = -0.1'),
    ({'self_contact': True, 'self_friction': np.nan}, 'self_friction = nan'),
])
def test_a_coefficient_that_makes_no_sense_is_refused(more, message):
    with pytest.raises(InvalidTask, match=message):
        simulator(**more)


def test_it_needs_a_radius():
    bare = Rod(length=1.0, mass_per_length=0.1, bending_stiffness=1.0, torsional_stiffness=1.0)
    with pytest.raises(InvalidTask, match=r'Rod\.radius = None'):
        DirectSimulator(bare, self_contact=True)


def test_rings_are_refused():
    ring = Hold(Pose.looking_along((0.2, 0, 0), (1, 0, 0)), 'ring', 0.25, slip=0.0)
    with pytest.raises(InvalidTask, match='self_contact = True: expected False where the DLO sl'):
        simulator(self_contact=True).solve(GRIPPER, holds=[ring], far_end=far(0.0))
