# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Drawing a DLO over a bar on a straight way: where it touches, how its direction drifts."""

import numpy as np
import pytest

from dlo_planner import (
    Capsule,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Trajectory,
)

BAR = (0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02
TOP = Pose((0.5, 0.0, 0.72), (0.0, 0.0, 0.0, 1.0))
WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))
LENGTHS = np.linspace(0.7, 0.5, 5)


def over_bar(friction=0.0, **options):
    return InverseSimulator(DirectSimulator(
        WIRE, obstacles=[Capsule(*BAR, friction=friction)], **options))


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
    # the drift is the plan's; what the motion adds is small
    still = plan.position_error.max()
    assert still < way.motion.position_error + 1e-4 <= still + way.tolerance


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
