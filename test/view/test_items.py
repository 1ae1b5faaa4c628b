# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is drawn of shapes, plans and cells."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.model.obstacles import ball
from dlo_planner.view.colors import ALERT
from dlo_planner.view.primitives import KINDS
from dlo_planner.view.scene import (
    contact_primitives,
    cutout_primitives,
    dlo_primitives,
    estimate_primitives,
    ghost_primitives,
    margin_primitives,
    obstacle_primitives,
    path_primitives,
)
from dlo_planner.view.summary import plan_columns

LEVEL = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
WIRE = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01)
HOLE = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.03)


@pytest.fixture(scope='module')
def plan():
    inverse = InverseSimulator(DirectSimulator(WIRE, n_elements=12, n_terms=6))
    return inverse.thread(HOLE, depths=np.linspace(0, 0.5, 9))


def named(items, group):
    return [item for item in items if item.group == group]


def test_names_are_unique(plan):
    drawn = [*dlo_primitives(plan.shapes[0]), *ghost_primitives(plan.shapes),
             *margin_primitives(plan, [HOLE]), *cutout_primitives([HOLE]),
             *path_primitives(plan.grippers), *obstacle_primitives([
                 Plane((0, 0, 0), (0, 0, 1)), Sphere((0, 0, 0), 0.1),
                 Capsule((0, 0, 0), (0, 0, 1), 0.1), Box(LEVEL, (1, 2, 3)),
                 Capsule((1, 0, 0), (0, 0, 1), 0.1), Sheet.around(HOLE)])]
    assert len({item.name for item in drawn}) == len(drawn)
    assert {item.kind for item in drawn} <= set(KINDS)


def test_the_dlo_is_as_thick_as_it_is(plan):
    tube, scale = dlo_primitives(plan.shapes[0])
    np.testing.assert_array_equal(tube.points, plan.shapes[0].positions)
    assert tube.size[0] == 0.02 and len(tube.colors) == len(tube.points)
    assert '1/m' in scale.text


def test_the_margin_is_the_least_of_the_plan(plan):
    drawn = margin_primitives(plan, [HOLE])
    margin = plan.clearances[:, 0].min()
    assert 0.01 < margin < 0.02  # of 0.02 m at most
    assert named(drawn, 'rim margin')[0].text == f'rim margin {1e3 * margin:.2g} mm'
    ring = named(drawn, 'margin')[0]
    np.testing.assert_allclose(np.linalg.norm(ring.points, axis=1), 0.03)
    plain = CutOut(HOLE.pose)
    assert margin_primitives(plan, [plain]) == []


def test_a_negative_margin_is_an_alert(plan):
    worse = plan.clearances.copy()
    worse[3, 0, 0] = -1e-3
    drawn = margin_primitives(replace(plan, clearances=worse), [HOLE])
    np.testing.assert_array_equal(named(drawn, 'margin')[0].colors[0], ALERT)
    assert '-1 mm' in named(drawn, 'rim margin')[0].text


@pytest.mark.parametrize('part', [1, 2])
def test_the_margin_counts_what_is_before_the_sheet_and_behind(plan, part):
    worse = plan.clearances.copy()
    worse[3, 0, part] = 4e-3
    drawn = margin_primitives(replace(plan, clearances=worse), [HOLE])
    assert named(drawn, 'rim margin')[0].text == 'rim margin 4 mm'
    columns = {name: worst for name, _, worst, _ in plan_columns(replace(plan, clearances=worse))}
    assert columns['room in the cut-outs'] == 4e-3


@pytest.mark.parametrize(('asked', 'drawn'), [(0, 0), (1, 1), (4, 4), (9, 9), (50, 9)])
def test_ghosts_are_spread_over_the_plan(plan, asked, drawn):
    ghosts = ghost_primitives(plan.shapes, asked)
    assert len(ghosts) == drawn and all(ghost.alpha < 1 for ghost in ghosts)
    if drawn > 1:
        np.testing.assert_array_equal(ghosts[0].points, plan.shapes[0].positions)
        np.testing.assert_array_equal(ghosts[-1].points, plan.shapes[-1].positions)


def test_contact_forces_are_in_proportion():
    floor = Plane((0, 0, 0.95), (0, 0, 1))
    soft = Rod(1.0, 0.5, 0.05, 0.04, radius=0.005)
    shape = DirectSimulator(soft, n_elements=24, n_terms=12, obstacles=[floor]).track([LEVEL])[0]
    drawn = contact_primitives(shape)
    arrows, texts = named(drawn, 'contact'), named(drawn, 'contact force')
    forces = np.array([np.linalg.norm(one.vector) for one in shape.contacts])
    forces = forces[forces > 0]
    assert len(arrows) == len(texts) == len(forces) > 0
    lengths = [np.linalg.norm(np.diff(arrow.points, axis=0)) for arrow in arrows]
    np.testing.assert_allclose(lengths, 0.1 * forces / forces.max())
    assert texts[0].text == f'{forces[0]:.3g} N'
    assert arrows[0].points[1, 2] > arrows[0].points[0, 2]  # the floor pushes up
    assert contact_primitives(DirectSimulator(soft, n_elements=8, n_terms=4).solve(LEVEL)) == []


def test_estimates_show_what_was_seen(plan):
    shape = plan.shapes[0]
    assert [item.group for item in estimate_primitives(shape)] == ['estimate']
    seen = estimate_primitives(shape, shape.positions[::3])[1]
    assert seen.kind == 'points' and len(seen.points) == 5
    with pytest.raises(InvalidTask, match='points'):
        estimate_primitives(shape, [(0, 0, np.nan)])


class Row(Sphere):
    """What is drawn by five bodies."""

    @property
    def solids(self):
        return tuple(ball(self.center + [k, 0, 0], self.radius) for k in range(5))


def test_no_solid_takes_the_place_of_another():
    names = [(one.group, one.index) for one in obstacle_primitives([Row((0, 0, 0), 0.5)] * 3)]
    assert len(set(names)) == len(names) == 15


def test_obstacles_are_where_they_are():
    bar = Capsule((1, 2, 3), (1, 2, 5), 0.1)
    body, one, other = obstacle_primitives([bar])
    np.testing.assert_allclose(body.pose.position, (1, 2, 4))
    np.testing.assert_allclose(np.abs(body.pose.rotation[:, 2]), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(body.size, (0.2, 0.2, 2.0))
    np.testing.assert_allclose([one.pose.position, other.pose.position], [(1, 2, 3), (1, 2, 5)])
    flat, = obstacle_primitives([Cylinder((1, 2, 3), (1, 2, 5), 0.1)])  # without the round ends
    assert (flat.kind, flat.pose) == ('cylinder', body.pose)
    np.testing.assert_allclose(flat.size, body.size)
    wall = obstacle_primitives([Plane((1, 0, 0), (1, 1, 0))])[0]
    normal = np.array((1, 1, 0)) / np.sqrt(2)
    world = wall.points @ wall.pose.rotation.T + wall.pose.position
    np.testing.assert_allclose((world - (1, 0, 0)) @ normal, 0, atol=1e-12)
