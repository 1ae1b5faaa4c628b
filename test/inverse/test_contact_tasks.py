# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Holding a contact, and sliding along it."""

from types import SimpleNamespace

import numpy as np
import pytest
from sweeps.contact import MESHES, branch, energies, held_or_refused, random_contact, scan

from dlo_planner import (
    Capsule,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Trajectory,
)
from dlo_planner.inverse.contact_branch import STABLE, ContactBranch
from dlo_planner.inverse.continuation import BranchPoint
from dlo_planner.inverse.tasks import contact
from dlo_planner.inverse.tasks.contact import LEAST_FORCE, MOST_FORCE, PRESSED, StraightSlide
from dlo_planner.plan.clearance import clearance
from dlo_planner.progress import Progress

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
BAR = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
TOP = Pose((0.5, 0, 0.72), (0, 0, 0, 1))  # level, along x
WEIGHT = WIRE.mass_per_length * 9.81


def planner(basis='local'):
    return InverseSimulator(DirectSimulator(WIRE, basis=basis, n_elements=64, obstacles=[BAR]))


@pytest.mark.sweep
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_the_family_keeps_contact_and_direction(basis):
    inverse = planner(basis)
    plan = inverse.hold_contact(TOP, 0.6, condition=None)
    assert len(plan) > 10
    forces = []
    shape = plan.shapes[0]
    for gripper in plan.grippers:
        shape = inverse.simulator.solve(gripper, shape)
        assert shape.converged and len(shape.contacts) == 1
        contact = shape.contacts[0]
        assert contact.s == pytest.approx(0.6, abs=1e-3)
        np.testing.assert_allclose(shape.at(contact.s).direction, [1, 0, 0], atol=2e-3)
        np.testing.assert_allclose(contact.normal, [0, 0, 1], atol=3e-3)
        forces.append(contact.force)
    assert (np.diff(forces) > 0).all()
    assert plan.position_error.max() < 1e-4 and plan.misalignment.max() < 2e-3
    # what hangs beyond the contact is the same for all
    tails = [one.positions_at([0.9])[0] for one in plan.shapes]
    assert np.ptp(tails, axis=0).max() < 5e-4


def test_conditions_choose_what_they_say():
    inverse = planner()
    some = {'forces': np.linspace(0.2, 2.4, 10) * WEIGHT}
    whole = inverse.hold_contact(TOP, 0.6, condition=None, **some)
    energies = [shape.elastic_energy for shape in whole.shapes]
    calm = inverse.hold_contact(TOP, 0.6, **some)
    assert calm.shapes[0].elastic_energy == pytest.approx(min(energies))
    light = inverse.hold_contact(TOP, 0.6, condition='least_force', **some)
    assert light.shapes[0].contacts[0].force == pytest.approx(whole.shapes[0].contacts[0].force)
    near = inverse.hold_contact(TOP, 0.6, condition='least_motion', start=whole.grippers[7],
                                **some)
    np.testing.assert_allclose(near.grippers[0].matrix, whole.grippers[7].matrix, atol=1e-12)
    floor = Plane((0, 0, 0.3), (0, 0, 1))
    roomy = InverseSimulator(DirectSimulator(WIRE, basis='local', n_elements=64,
                                             obstacles=[BAR, floor]))
    far = roomy.hold_contact(TOP, 0.6, condition='largest_clearance', **some).shapes[0]
    lowest = [shape.positions[:, 2].min() for shape in whole.shapes]
    assert far.positions[:, 2].min() == pytest.approx(max(lowest), abs=1e-6)


def test_a_contact_that_is_stable_because_it_rolls_is_held():
    # the mesh on which the force is chosen has a node there, and says a stability of -0.4
    rod = Rod(0.4043, 0.114, 0.00273, 0.000581, radius=2e-3)
    contact = Pose((0, 0, 0), (0.114, 0.606, 0.615, 0.492))
    normal = contact.rotation[:, 2]
    axis = np.cross(normal, np.cross((-0.259, 0.217, 0.222), normal))
    axis /= np.linalg.norm(axis)
    bar = Capsule(-0.0964 * normal - 0.2 * axis, -0.0964 * normal + 0.2 * axis, 0.0964)
    plan = InverseSimulator(DirectSimulator(rod, obstacles=[bar])).hold_contact(contact, 0.2805)
    fine = DirectSimulator(rod, obstacles=[bar], basis='local', n_elements=200).solve(
        plan.grippers[0], plan.shapes[0])
    assert fine.converged and fine.stability == pytest.approx(plan.stability[0], rel=0.1)
    np.testing.assert_allclose(fine.positions[-1], plan.shapes[0].positions[-1], atol=4e-4)


def test_a_leaf_spring_lies_flat_on_the_bar():
    spring = Rod.rectangular(0.5, 12e-3, 0.5e-3, 7850, 206e9, 0.3)
    bar = Capsule((0.2, -0.5, 0.7), (0.2, 0.5, 0.7), 0.02)
    inverse = InverseSimulator(DirectSimulator(spring, obstacles=[bar]))
    plan = inverse.slide_contact(Pose((0.2, 0, 0.72), (0, 0, 0, 1)), [0.3, 0.25, 0.2])
    for s, shape in zip((0.3, 0.25, 0.2), plan.shapes, strict=True):
        assert shape.contacts
        np.testing.assert_allclose([one.s for one in shape.contacts], s, atol=1e-3)
        np.testing.assert_allclose(shape.at(s).position, (0.2, 0, 0.72 + 0.25e-3), atol=1e-5)


def test_sliding_draws_the_dlo_over_the_bar():
    inverse = planner()
    lengths = np.linspace(0.65, 0.35, 7)
    plan = inverse.slide_contact(TOP, lengths, forces=np.linspace(0.2, 2.8, 14) * WEIGHT)
    assert plan.fraction == 1
    np.testing.assert_allclose(plan.depths, 1 - lengths)
    shapes = inverse.simulator.track(plan.grippers, initial=plan.shapes[0])
    for s, shape in zip(lengths, shapes, strict=True):
        assert shape.converged and not shape.jumped
        assert shape.contacts[0].s == pytest.approx(s, abs=2e-3)
        np.testing.assert_allclose(shape.at(s).direction, [1, 0, 0], atol=5e-3)
    steps = [np.linalg.norm(b.position - a.position)
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert max(steps) < 0.15


FLOOR = Plane((0, 0, 0.3), (0.6, 0, 0.8))
BENT = Rod(1.0, 0.05, (0.16, 0.78), 0.05, natural_curvature=(-0.5, 0.6), natural_twist=0.4,
           radius=2e-3)


@pytest.mark.sweep
@pytest.mark.parametrize('rod', [WIRE, BENT], ids=['round', 'bent'])
def test_conditions_choose_the_least_of_all_forces(rod):
    direct = DirectSimulator(rod, basis='local', n_elements=64, obstacles=[BAR, FLOOR])
    inverse, start = InverseSimulator(direct), Pose((-0.05, 0.02, 0.75), (0, 0, 0, 1))
    many = ContactBranch(direct, TOP, 0.6, lambda: None)
    forces = np.geomspace(PRESSED * many.scale[0], MOST_FORCE * many.scale[1], 300)
    shapes = [many.shape(force) for force in forces if many.merit(force) > 0]
    assert 30 < len(shapes) < 300

    def away(shape):
        turn = 1 - 0.25 * (1 + np.trace(shape.gripper.rotation @ start.rotation.T))
        return np.sum((shape.gripper.position - start.position) ** 2) + turn

    def force(shape):
        return sum(one.force for one in shape.contacts)

    for condition, cost in (('least_energy', lambda shape: shape.elastic_energy),
                            ('least_force', force), ('least_motion', away),
                            ('largest_clearance',
                             lambda shape: -clearance([FLOOR], rod.radius, shape))):
        chosen = inverse.hold_contact(TOP, 0.6, condition=condition, start=start).shapes[0]
        least = min(cost(shape) for shape in shapes)
        assert cost(chosen) <= least + 2e-3 * abs(least), condition
        assert chosen.converged and chosen.contacts[0].s == pytest.approx(0.6, abs=1e-3)


@pytest.mark.sweep
def test_the_family_goes_as_far_as_it_is_stable():
    direct = DirectSimulator(WIRE, basis='local', n_elements=64, obstacles=[BAR])
    inverse = InverseSimulator(direct)
    plan = inverse.hold_contact(TOP, 0.6, condition=None, min_force=0.0)
    forces = np.array([shape.contacts[0].force for shape in plan.shapes])
    scale = WEIGHT + WIRE.bending_stiffness[0]
    assert forces[0] == pytest.approx(LEAST_FORCE * scale, rel=0.01)
    assert plan.stability[-1] == pytest.approx(STABLE, abs=5e-3)
    assert forces[-1] == pytest.approx(2.5 * WEIGHT, rel=0.02)  # as docs/theory.md says
    held = scan(direct, TOP, 0.6, decades=4, per_decade=6)  # Runge-Kutta and direct simulation
    assert 0.6 * forces[-1] < max(held) < 1.1 * forces[-1] and min(held) < 1.6 * forces[0]
    turns = [np.arccos(np.clip(0.5 * (np.trace(a.rotation.T @ b.rotation) - 1), -1, 1))
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert max(turns) < 0.13


def test_the_family_is_that_of_kirchhoffs_equations():
    direct = DirectSimulator(BENT, basis='local', n_elements=128, obstacles=[BAR])
    forces = [0.05, 0.2]
    nodes, strains, frames, positions = branch(BENT, TOP, 0.6, forces)
    mine = ContactBranch(direct, TOP, 0.6, lambda: None, 128)
    for k, force in enumerate(forces):
        shape = mine.shape(force)
        np.testing.assert_allclose(shape.gripper.position, positions[k, 0], atol=3e-5)
        np.testing.assert_allclose(shape.gripper.rotation, frames[k, 0], atol=1e-4)
        assert shape.elastic_energy == pytest.approx(energies(BENT, nodes, strains)[k], rel=1e-3)


def test_a_contact_that_rolls_is_more_stable():
    direct = DirectSimulator(BENT, basis='local', obstacles=[BAR])
    shape = InverseSimulator(direct).hold_contact(TOP, 0.6, forces=[0.2]).shapes[0]
    mine = ContactBranch(direct, TOP, 0.6, lambda: None).shape(0.2)
    assert shape.stability == pytest.approx(mine.stability, rel=0.01)


@pytest.mark.sweep
@pytest.mark.parametrize('rod', [WIRE, BENT], ids=['round', 'bent'])
def test_with_an_accuracy_as_with_elements(rod):
    fine = InverseSimulator(DirectSimulator(rod, accuracy=1e-5, obstacles=[BAR]))
    some = InverseSimulator(DirectSimulator(rod, basis='local', n_elements=512, obstacles=[BAR]))
    one, other = (inverse.hold_contact(TOP, 0.6).shapes[0] for inverse in (fine, some))
    assert one.error_estimate < 1e-5 and one.contacts
    np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, atol=2e-3)
    assert one.elastic_energy == pytest.approx(other.elastic_energy, rel=1e-4)
    forces = [0.05, 0.1]
    one, other = (inverse.hold_contact(TOP, 0.6, condition=None, forces=forces, min_force=0.05)
                  for inverse in (fine, some))
    for k in range(2):
        np.testing.assert_allclose(one.grippers[k].matrix, other.grippers[k].matrix, atol=2e-5)
        samples = np.linspace(0.1, 1, 10)
        np.testing.assert_allclose(one.shapes[k].positions_at(samples),
                                   other.shapes[k].positions_at(samples), atol=3e-5)
    assert one.position_error.max() < 1e-5


@pytest.mark.sweep
def test_sliding_does_not_leap():
    inverse = planner()
    for condition in ('least_energy', 'least_motion'):
        rough = inverse.slide_contact(TOP, np.linspace(0.6, 0.45, 4), condition=condition)
        closer = inverse.slide_contact(TOP, np.linspace(0.6, 0.45, 7), condition=condition)
        steps = [max(np.linalg.norm(b.matrix - a.matrix) for a, b in zip(
            plan.grippers, plan.grippers[1:], strict=False)) for plan in (rough, closer)]
        assert steps[1] < 0.7 * steps[0]


def test_a_contact_that_curves_inwards_is_refused():
    wall = Plane((0, 0, 0.7), (0, 0, 1))
    inverse = InverseSimulator(DirectSimulator(WIRE, obstacles=[wall]))
    with pytest.raises(Infeasible, match='in an obstacle') as caught:
        inverse.hold_contact(Pose((0, 0, 0.7), (0, 0, 0, 1)), 0.5)
    assert caught.value.constraint == 'contact' and 0 < caught.value.amount < 1


def test_random_contacts_are_held_or_refused_rightly():
    rng = np.random.default_rng(11)
    for index in range(6):
        what = held_or_refused(*random_contact(rng), MESHES[index % 2]).what
        assert what in ('held', 'confirmed')


def pushes(plan):
    return np.array([sum(one.force for one in shape.contacts) for shape in plan.shapes])


@pytest.mark.sweep
def test_plans_press_by_a_tenth_of_their_own_scale():
    inverse, scale = planner(), WEIGHT + WIRE.bending_stiffness[0]
    assert pushes(inverse.hold_contact(TOP, 0.6, condition=None)).min() >= 0.0999 * scale
    least = inverse.hold_contact(TOP, 0.6, condition='least_force')
    assert pushes(least)[0] == pytest.approx(0.1 * scale, rel=1e-3)
    slid = inverse.slide_contact(TOP, [0.65, 0.6], condition='least_force', min_force=0.05)
    np.testing.assert_allclose(pushes(slid), 0.05, rtol=0.01)
    with pytest.raises(Infeasible, match='at least 0.05 N') as caught:
        inverse.hold_contact(TOP, 0.6, forces=[0.01, 0.03], min_force=0.05)
    assert (caught.value.constraint, caught.value.unit) == ('contact_force', 'N')
    assert caught.value.amount == pytest.approx(0.02, rel=1e-3)
    assert str(caught.value).endswith('(contact_force, by 0.02 N)')
    # going straight towards the bar with the way back, the contact becomes lighter
    with pytest.raises(Infeasible, match='min_force') as caught:
        inverse.slide_contact(TOP, [0.6, 0.65, 0.7], mode='straight', forces=[0.12],
                              min_force=0.11)
    assert caught.value.constraint == 'contact_force' and caught.value.waypoint > 0


def test_what_cannot_be_held_is_refused():
    with pytest.raises(Infeasible, match='contact force') as caught:
        planner().hold_contact(TOP, 0.6, forces=[5 * WEIGHT, 6 * WEIGHT])  # it would fall aside
    assert (caught.value.constraint, caught.value.unit) == ('contact', '')
    assert caught.value.amount > 0.02  # of stability: where the DLO would come to is not told


@pytest.mark.parametrize(('change', 'named'), [
    ({'contact': 3}, 'contact'), ({'s': 2.0}, 's = 2'), ({'condition': 'nicest'}, 'condition'),
    ({'condition': 'least_motion'}, 'start'),
    ({'contact': Pose((0.5, 0, 0.73), (0, 0, 0, 1))}, 'surface'),
    ({'contact': Pose((0.5, 0, 0.72), (0, 0.1, 0, 0.99))}, 'surface'),
    ({'forces': [-1.0]}, r'forces\[0\]'), ({'min_force': -1.0}, 'min_force = -1')])
def test_nonsense_is_named(change, named):
    with pytest.raises(InvalidTask, match=named):
        planner().hold_contact(**{'contact': TOP, 's': 0.6, **change})
    with pytest.raises(InvalidTask, match='obstacles'):
        InverseSimulator(DirectSimulator(WIRE)).hold_contact(TOP, 0.6)


SLIDE_WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))
LENGTHS = np.linspace(0.7, 0.5, 5)


def over_bar(friction=0.0, **options):
    return InverseSimulator(DirectSimulator(
        SLIDE_WIRE, obstacles=[Capsule(BAR.start, BAR.end, 0.02, friction=friction)], **options))


def test_nothing_rubs_in_a_plan_that_holds_a_contact():
    # on ten terms friction held what they are off by: 0.06 of the force, where there is none
    found = []
    for friction in (0.0, 1.0):
        inverse = InverseSimulator(DirectSimulator(
            WIRE, n_elements=64, obstacles=[Capsule(BAR.start, BAR.end, 0.02, friction=friction)]))
        plan = inverse.slide_contact(TOP, [0.7, 0.6], condition='least_force')
        found += [shape.contacts for shape in plan.shapes]
    for (smooth,), (rough,) in zip(found[:2], found[2:], strict=True):
        assert rough.force == pytest.approx(smooth.force, rel=1e-4)
        assert np.linalg.norm(rough.friction) < 1e-5 * rough.force


@pytest.mark.parametrize('friction', [0.0, 0.2])
def test_the_gripper_goes_straight_to_the_contact(friction):
    inverse = over_bar(friction, basis='local', n_elements=24)
    plan = inverse.slide_contact(TOP, LENGTHS, mode='straight')
    begin, place = plan.grippers[0], plan.via_points[0][0][0]
    gone = np.array([(gripper.position - begin.position) @ (place - begin.position)
                     for gripper in plan.grippers]) / np.sum((place - begin.position)**2)
    for part, gripper in zip(gone, plan.grippers, strict=True):
        np.testing.assert_allclose(gripper.rotation, begin.rotation, atol=1e-12)
        np.testing.assert_allclose(gripper.position, begin.position + part * (
            place - begin.position), atol=1e-12)
    assert (np.diff(gone) > 0.02).all() and gone[-1] < 1
    # as the direct simulation of a finer DLO has it
    fine = over_bar(friction, basis='local', n_elements=80).simulator
    shapes = fine.track(plan.grippers, initial=fine.solve(plan.grippers[0], plan.shapes[0]))
    for shape, s, drift, miss in zip(shapes, LENGTHS, plan.misalignment, plan.position_error,
                                     strict=True):
        touch = max(shape.contacts, key=lambda one: one.force)
        assert shape.converged and touch.s == pytest.approx(s, abs=2e-3)
        axis = shape.frame_at(touch.s)
        assert np.arccos(axis[0][0, 0]) == pytest.approx(drift, abs=1e-3)
        assert np.linalg.norm(axis[1] - place) == pytest.approx(miss, abs=1e-4)
    assert (np.diff(plan.misalignment) > 0.01).all()  # other than on the way that keeps it
    kept = inverse.slide_contact(TOP, LENGTHS[:2])
    assert kept.misalignment.max() < 1e-3 and kept.grippers[0] == begin


def test_it_goes_back_the_same_way():
    inverse = over_bar(basis='local', n_elements=24)
    there = inverse.slide_contact(TOP, [0.6, 0.56], mode='straight')
    forth = inverse.slide_contact(TOP, [0.6, 0.56, 0.6, 0.65], mode='straight')
    np.testing.assert_allclose(forth.grippers[1].position, there.grippers[1].position)
    np.testing.assert_allclose(forth.grippers[2].position, there.grippers[0].position, atol=1e-5)
    np.testing.assert_allclose(forth.depths, [0.4, 0.44, 0.4, 0.35])
    assert forth.via_points[3][0][1] == pytest.approx(0.65, abs=1e-5)


def test_it_is_proved_in_motion():
    plan = over_bar(basis='local', n_elements=24).slide_contact(TOP, LENGTHS, mode='straight')
    way = Trajectory(plan)
    assert way.motion.contact_force > 0.05
    assert way.motion.position_error <= plan.position_error.max() + way.tolerance


def test_refusals():
    inverse = over_bar(basis='local', n_elements=24)
    with pytest.raises(InvalidTask, match='mode'):
        inverse.slide_contact(TOP, LENGTHS, mode='curved')
    with pytest.raises(Infeasible, match='on the straight way') as caught:  # it lifts off the bar
        inverse.slide_contact(TOP, [0.7, 0.69, 0.3], mode='straight', forces=[2e-3],
                              min_force=0.0)
    error = caught.value
    assert error.constraint == 'contact' and 0 < error.amount < 0.05
    assert error.waypoint == 2 and len(error.plan) == 2


class Falling(StraightSlide):
    """Slides a DLO of 1 m that falls where 0.37 of the way are gone, before it touches at 0.5 m."""

    def __init__(self):
        self.simulator = SimpleNamespace(rod=SimpleNamespace(length=1.0))
        self.problem = SimpleNamespace(demands=SimpleNamespace(progress=Progress()))
        self.tried = []

    def _gone(self, shape):
        return shape.gone

    def _touches_at(self, shape, s):
        return 0.7 - 0.1 * shape.gone

    def _at(self, gone, before):
        self.tried.append((before.gone, gone))
        return SimpleNamespace(gone=gone, converged=True, jumped=before.gone < 0.37 < gone,
                               since=before)


def test_what_falls_is_sought_from_the_last_shape_before(monkeypatch):
    monkeypatch.setattr(contact, 'apart', lambda one, other: 0.1)
    slide = Falling()
    assert slide.at(BranchPoint(SimpleNamespace(gone=0.0), depth=0.3), 0.5) is None
    fell = next(k for k, (_, gone) in enumerate(slide.tried) if gone > 0.37)
    reached = max(gone for _, gone in slide.tried[:fell])
    for begin, gone in slide.tried[fell + 1:]:
        assert begin == reached
        reached = max(reached, gone if gone < 0.37 else 0.0)
    assert 0.37 - 1e-5 < reached < 0.37 and len(slide.tried) < 25  # of 36 to the last digits
    assert slide._ended[0] == 'continuity'
