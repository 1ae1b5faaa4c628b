"""Holding and sliding a contact: confirmed by the direct simulator with the obstacle in."""

import numpy as np
import pytest

from dlo_planner import (
    Capsule,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
)

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
BAR = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
TOP = Pose((0.5, 0, 0.72), (0, 0, 0, 1))  # level, along x
WEIGHT = WIRE.mass_per_length * 9.81


def planner(basis='local'):
    return InverseSimulator(DirectSimulator(WIRE, basis=basis, obstacles=[BAR]))


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
    assert plan.miss.max() < 1e-4 and plan.misalignment.max() < 2e-3
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
    roomy = InverseSimulator(DirectSimulator(WIRE, basis='local', obstacles=[BAR, floor]))
    far = roomy.hold_contact(TOP, 0.6, condition='largest_clearance', **some).shapes[0]
    lowest = [shape.positions[:, 2].min() for shape in whole.shapes]
    assert far.positions[:, 2].min() == pytest.approx(max(lowest), abs=1e-6)


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


def test_what_cannot_be_held_is_refused():
    with pytest.raises(Infeasible, match='contact force') as caught:
        planner().hold_contact(TOP, 0.6, forces=[5 * WEIGHT, 6 * WEIGHT])  # it would fall aside
    assert caught.value.constraint == 'contact'


@pytest.mark.parametrize(('change', 'named'), [
    ({'contact': 3}, 'contact'), ({'s': 2.0}, 's = 2'), ({'condition': 'nicest'}, 'condition'),
    ({'condition': 'least_motion'}, 'start'), ({'forces': [-1.0]}, r'forces\[0\]')])
def test_nonsense_is_named(change, named):
    with pytest.raises(InvalidTask, match=named):
        planner().hold_contact(**{'contact': TOP, 's': 0.6, **change})
    with pytest.raises(InvalidTask, match='obstacles'):
        InverseSimulator(DirectSimulator(WIRE)).hold_contact(TOP, 0.6)
