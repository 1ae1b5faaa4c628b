# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole way through a cut-out, as parameters ask for it: what is cut or joined is checked."""

import numpy as np
import pytest

from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    HoldContact,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
    Sphere,
    Thread,
)
from dlo_planner.inverse.tasks.thread_sequence import threading_of
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.workspace import Workspace
from dlo_planner.settings.build import direct_of, inverse_of
from dlo_planner.settings.parameters import PARAMETERS
from dlo_planner.settings.tasks import plan_task
from dlo_planner.settings.yaml_files import read_values

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
DIRECT = DirectSimulator(WIRE, n_elements=32)
HOLE = CutOut(Pose.looking_along((0.3, 0.1, 1.0), (0.95782629, 0.28734789, 0.0)))
WANTED = {name: entry.default for name, entry in PARAMETERS.items()} | {
    'threading.waypoints': 4, 'threading.deepest': 0.9}


def way(plan, count=2001):
    """Return (n, 3) places of the gripper on the path of a plan."""
    path = GripperPath.of(plan)
    return path.at(np.linspace(path.times[0], path.times[-1], count))[0]


def apart_from(places, *others):
    """Return the one of some places that is farthest from others, and how far it is, m."""
    far = np.min([np.linalg.norm(places[:, None] - other[None, ::2], axis=2).min(axis=1)
                  for other in others], axis=0)
    return places[np.argmax(far)], far.max()


def test_a_plan_that_ends_before_the_sheet_is_checked_again():
    inverse = InverseSimulator(DIRECT)
    whole = plan_task(inverse, threading_of([HOLE]), WANTED)
    cut = WANTED | {'threading.gripper_clearance': float(
        (HOLE.center - whole.grippers[-1].position) @ HOLE.normal) + 1e-3}
    part = plan_task(inverse, threading_of([HOLE]), cut)
    assert len(part) == 3 < len(whole)
    place, far = apart_from(way(part), way(whole))  # without its last pose it bulges elsewhere
    ball = Sphere(place, 0.5 * far)
    assert far > 1e-3
    kept = InverseSimulator(DIRECT, workspace=Workspace(keep_out=[ball]))
    assert len(plan_task(kept, threading_of([HOLE]), WANTED)) == 4
    with pytest.raises(Infeasible) as refused:
        plan_task(kept, threading_of([HOLE]), cut)
    assert refused.value.constraint == 'workspace.keep_out[0]'


def test_what_is_joined_is_in_time_by_its_speeds_and_begins_with_the_present_shape():
    start = Pose.looking_along(HOLE.center - 1.3 * HOLE.normal + (0, 0.2, 0.1), HOLE.normal)
    wanted = WANTED | {'threading.standoff': 0.05, 'threading.linear_speed': 0.02,
                       'threading.angular_speed': 0.05}
    inverse = InverseSimulator(DIRECT)
    plan = plan_task(inverse, threading_of([HOLE]), wanted, start=start)
    assert np.allclose(plan.grippers[0].matrix, start.matrix)
    speeds = plan.velocities
    assert np.linalg.norm(speeds[:, :3], axis=1).max() < 0.02 * (1 + 1e-9)
    assert np.linalg.norm(speeds[:, 3:], axis=1).max() < 0.05 * (1 + 1e-9)
    held = DIRECT.solve(start, far_end=start.position + (0.5, 0.0, 0.0))
    with pytest.raises(ValueError, match='initial'):  # what is held now is no beginning
        plan_task(inverse, threading_of([HOLE]), wanted, start=start, initial=held)


def test_the_way_down_to_a_contact_keeps_the_speeds_too():
    bar, on_bar = Capsule((0, -0.1, 0.98), (0, 0.1, 0.98), 0.02, 0.3), Pose((0, 0, 1), (0, 0, 0, 1))
    wire = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
    wanted = WANTED | {'threading.standoff': 0.02, 'threading.linear_speed': 0.02,
                       'contacts.tolerance': 3e-3}
    plan = plan_task(InverseSimulator(DirectSimulator(wire, obstacles=[bar])),
                     HoldContact(on_bar, 0.2, 'least_force'), wanted,
                     start=Pose.looking_along((-0.2, 0, 1.24), (1, 0, 0.2)))
    assert plan.shapes[-1].contacts and not plan.shapes[-3].contacts
    assert np.linalg.norm(plan.velocities[:, :3], axis=1).max() < 0.02 * (1 + 1e-9)


def test_what_is_joined_is_checked_as_a_whole(monkeypatch):
    checked = []
    monkeypatch.setattr(InverseSimulator, 'check', lambda _, plan: checked.append(plan) or plan)
    start = Pose.looking_along(HOLE.center - 1.3 * HOLE.normal, HOLE.normal)
    plan = plan_task(InverseSimulator(DIRECT), threading_of([HOLE]),
                     WANTED | {'threading.standoff': 0.05}, start=start)
    assert len(plan) > 4
    assert len(checked) == 1
    assert checked[0] is plan


def test_obstacles_are_for_the_dlo_and_for_the_gripper():
    values, _ = read_values('copper_wire', ['workspace.gripper_radius=0.05',
                                            'workspace.upper=[2, 2, 2]',
                                            'threading.may_yield=false'])
    balls = (Sphere((0, 0, 1), 0.1), Sphere((1, 0, 1), 0.1))
    direct = direct_of(values, balls)
    inverse = inverse_of(values, direct)
    assert direct.obstacles == inverse.workspace.keep_out == balls
    assert inverse.workspace.min_margin(Pose((1.0, 0.0, 1.17), (0, 0, 0, 1))) == (
        'workspace.keep_out[1]', pytest.approx(0.02))
    assert inverse.workspace.min_margin(Pose((1.9, 0.0, 0.0), (0, 0, 0, 1))) == (
        'workspace.upper.x', pytest.approx(0.05))
    assert not inverse.requirements.allow_plastic


def test_how_oblique_and_how_much_margin_are_parameters():
    wire = Rod(0.2, 0.0174, 1.22e-4, 1.0e-4, radius=1.5e-3)  # w L^3 / EI = 11
    inverse, wanted = InverseSimulator(DirectSimulator(wire)), WANTED | {
        'threading.waypoints': 20}
    cutout = CutOut(Pose.looking_along((0, 0, 1), (1, 0, -0.36)), radius=0.01)
    oblique = plan_task(inverse, threading_of([cutout]), wanted)
    assert oblique.misalignment.max() > 0.5
    along = plan_task(inverse, threading_of([cutout]),
                      wanted | {'threading.max_misalignment': 0.0})
    assert along.misalignment.max() < 1e-8
    # what the task itself says counts
    asked = plan_task(inverse, Thread(cutout, max_misalignment=0.5),
                      wanted | {'threading.max_misalignment': 0.0})
    assert 0.1 < asked.misalignment.max() < 0.5 + 1e-6
    with pytest.raises(Infeasible) as refused:
        plan_task(inverse, threading_of([cutout]), wanted | {'threading.margin': 0.008})
    assert 'margin = 0.008 m' in str(refused.value)
