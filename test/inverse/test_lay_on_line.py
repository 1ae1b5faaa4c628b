# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The free end laid on a line: as Kirchhoff's equations have it, or refused by name."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from dlo_planner import (
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    LayOnLine,
    Plane,
    Pose,
    Rod,
    Workspace,
    replay,
)
from dlo_planner.tasks import Requirements

LINE = Pose.looking_along((0.3, 0.1, 0.8), (1.0, 0.4, -0.2))
RODS = {'straight': Rod(0.9, 0.06, 0.15, 0.1, radius=2e-3),
        'bent strip': Rod(0.9, 0.06, (0.12, 0.3), 0.1, natural_curvature=(0.4, -0.3),
                          natural_twist=0.2, radius=2e-3)}


def inverse_of(rod, **options):
    return InverseSimulator(DirectSimulator(rod, basis='local', n_elements=128, **options))


def from_the_free_end(rod, frame, position, lengths):
    """Return frames (n, 3, 3) and positions (n, 3) at distances (n,), m, from a free end.

    Kirchhoff's equations, an initial value problem: neither force nor moment at the end.
    """
    stiffness = np.array([rod.torsional_stiffness, *np.broadcast_to(rod.bending_stiffness, 2)])
    natural = np.array([rod.natural_twist, *rod.natural_curvature])
    weight = rod.mass_per_length * np.array([0, 0, -9.81])

    def slopes(back, y):  # along the distance from the end, against the arc length
        axes, moment = y[:9].reshape(3, 3), y[9:12]
        strain = natural + axes.T @ moment / stiffness
        skew = np.array([[0, -strain[2], strain[1]], [strain[2], 0, -strain[0]],
                         [-strain[1], strain[0], 0]])
        along = axes[:, 0]
        return np.concatenate([-(axes @ skew).ravel(), np.cross(along, back * weight), -along])

    found = solve_ivp(slopes, (0, rod.length), np.concatenate([frame.ravel(), np.zeros(3),
                                                               position]),
                      t_eval=lengths, rtol=1e-10, atol=1e-12)
    return found.y[:9].T.reshape(-1, 3, 3), found.y[12:].T


def deviation(rod, frame, length):
    """Return the mean square of the tangents' deviation from the line, of the last part."""
    axes, _ = from_the_free_end(rod, frame, np.zeros(3), np.linspace(0, length, 9))
    return ((axes[:, :, 0] - LINE.direction) ** 2).sum(axis=1).mean()


@pytest.mark.parametrize('rod', RODS.values(), ids=RODS)
def test_the_end_and_its_tangent_are_on_the_line(rod):
    positions = [0.0, 0.05, 0.12]
    plan = inverse_of(rod).plan(LayOnLine(LINE, positions=positions), start=LINE)
    assert len(plan) == 3 and plan.status.value == 'complete'
    for position, gripper, shape in zip(positions, plan.grippers, plan.shapes, strict=True):
        frame, place = shape.frame_at(rod.length)
        np.testing.assert_allclose(place, LINE.position + position * LINE.direction, atol=1e-9)
        np.testing.assert_allclose(frame[:, 0], LINE.direction, atol=1e-9)
        axes, places = from_the_free_end(rod, frame, place, [0.0, rod.length])
        np.testing.assert_allclose(places[-1], gripper.position, atol=2e-5)
        np.testing.assert_allclose(axes[-1], gripper.rotation, atol=5e-5)
    report = replay(inverse_of(rod).simulator, plan)
    assert report.converged and max(report.position_error, report.misalignment) < 1e-6


@pytest.mark.every(2)
@pytest.mark.parametrize('rod', RODS.values(), ids=RODS)
def test_no_other_end_has_the_last_part_nearer_to_the_line(rod):
    length = 0.3
    task = LayOnLine(LINE, length, tolerance=0.05, angle_tolerance=0.3)
    plan = inverse_of(rod).plan(task, start=LINE)
    frame, place = plan.shapes[0].frame_at(rod.length)
    np.testing.assert_allclose(place, LINE.position, atol=1e-6)
    found = deviation(rod, frame, length)

    def turned(angles):
        across = angles[0] * frame[:, 1] + angles[1] * frame[:, 2]
        return deviation(rod, Rotation.from_rotvec(across).as_matrix() @ frame, length)

    best = minimize(turned, np.zeros(2), method='Nelder-Mead', options={'xatol': 1e-6})
    assert found < best.fun * (1 + 1e-3) and found > 1e-8
    at = rod.length - np.linspace(0, length, 5)
    off = [plan.shapes[0].frame_at(s)[1] - (LINE.position - (rod.length - s) * LINE.direction)
           for s in at]
    assert plan.position_error[0] == pytest.approx(np.linalg.norm(off, axis=1).max(), rel=1e-9)
    angles = [np.arccos(plan.shapes[0].frame_at(s)[0][:, 0] @ LINE.direction) for s in at]
    assert plan.misalignment[0] == pytest.approx(max(angles), rel=1e-6)
    assert plan.misalignment[0] < 0.3 and plan.position_error[0] < 0.05


def test_a_longer_part_than_the_tolerances_allow_is_refused():
    inverse, angles = inverse_of(RODS['straight']), []
    for length in (0.1, 0.2, 0.3):
        plan = inverse.plan(LayOnLine(LINE, length, tolerance=0.05, angle_tolerance=0.3))
        angles.append(plan.misalignment[0])
    assert angles == sorted(angles) and angles[0] < 0.1 * angles[-1]
    least = plan.position_error[0]
    for tolerances, constraint in (((0.9 * least, 0.3), 'tolerance'),
                                   ((0.05, 0.9 * angles[-1]), 'angle_tolerance')):
        with pytest.raises(Infeasible, match='off') as refused:
            inverse.plan(LayOnLine(LINE, 0.3, (0.0,), *tolerances))
        assert refused.value.constraint == constraint and refused.value.amount > 0
    with pytest.raises(Infeasible) as refused:  # of all plans
        inverse.plan(LayOnLine(LINE, 0.3, tolerance=0.05, angle_tolerance=0.3),
                     requirements=Requirements(tolerance=0.9 * least))
    assert refused.value.constraint == 'tolerance'


def test_a_line_on_a_plane_is_as_far_above_it_as_the_dlo_is_thick():
    floor = Plane((0, 0, 0.5), (0, 0, 1))
    inverse = inverse_of(Rod(0.9, 0.06, 0.15, 0.1, natural_curvature=(0.0, -0.5), radius=2e-3),
                         obstacles=[floor])
    on_it = Pose.looking_along((0.3, 0.1, 0.5021), (1.0, 0.4, 0.0))
    plan = inverse.plan(LayOnLine(on_it, positions=np.linspace(0, 0.2, 5)))
    assert plan.fraction == 1 and plan.shapes[0].positions[:, 2].min() > 0.502
    with pytest.raises(Infeasible) as refused:
        inverse.plan(LayOnLine(Pose(on_it.position - [0, 0, 5e-4], on_it.quaternion)))
    assert refused.value.constraint == 'clearance'


def test_another_roll_of_a_bent_dlo_keeps_the_workspace():
    inverse = inverse_of(RODS['bent strip'])
    first = inverse.plan(LayOnLine(LINE)).grippers[0].position
    aside = np.cross(LINE.direction, [0, 0, 1])
    aside *= np.sign(aside @ (first - LINE.position))
    wall = Workspace(keep_out=[Plane(first - 0.01 * aside, -aside)])
    plan = inverse.plan(LayOnLine(LINE), requirements=Requirements(workspace=wall))
    assert np.linalg.norm(plan.grippers[0].position - first) > 0.01
    assert max(plan.position_error[0], plan.misalignment[0]) < 1e-9


def test_a_dlo_that_does_not_stand_so_is_refused():
    soft = inverse_of(Rod(0.9, 0.06, 1e-3, 1e-3))
    with pytest.raises(Infeasible) as refused:
        soft.plan(LayOnLine(Pose.looking_along((0, 0, 1), (0.1, 0, 1.0))))
    assert refused.value.constraint == 'stability' and refused.value.waypoint == 0


@pytest.mark.parametrize(('change', 'named'), [
    ({'line': 3}, 'line'), ({'length': -1}, 'length'), ({'positions': []}, 'positions'),
    ({'tolerance': 0.0}, 'tolerance'), ({'angle_tolerance': 0}, 'angle_tolerance')])
def test_nonsense_is_named(change, named):
    with pytest.raises(InvalidTask, match=named):
        LayOnLine(**{'line': LINE, **change})
    with pytest.raises(InvalidTask, match='length = 2'):
        inverse_of(RODS['straight']).plan(LayOnLine(LINE, 2.0))
