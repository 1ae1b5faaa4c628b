# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO comes near to in motion."""

from dataclasses import fields, replace

import numpy as np
import pytest

from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Trajectory,
    replay,
)
from dlo_planner.direct.grips import between
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import Bodies, clearance, hole_clearances
from dlo_planner.plan.plan import PlanStatus, truncate
from dlo_planner.plan.swept import least_between
from dlo_planner.trajectory.calm_search import CalmSearch
from dlo_planner.trajectory.dynamic_check import InMotion

ROD = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
DIRECT = DirectSimulator(ROD)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
LIMITS = Limits(0.2, 1.0)


@pytest.fixture(scope='module')
def way():
    """Return the Plan of a short way sideways, of two waypoints."""
    inverse = InverseSimulator(DIRECT)
    start = Pose.looking_along((-0.5, -0.1, 1.02), (1, 0, 0))
    plan = inverse.approach(HOLE, inverse.thread(HOLE, start=start, depths=[0, 0.1]), start,
                            standoff=0.05)
    return truncate(plan, 2, PlanStatus.COMPLETE)


def beside(plan, distance, radius):
    """Return a Sphere beside where the free end comes through half way, m from the DLO's axis."""
    pose = between(*plan.grippers, 0.5)
    middle = DIRECT.track([pose], initial=plan.shapes[0])[0].positions[-1]
    along = plan.shapes[1].positions[-1] - plan.shapes[0].positions[-1]
    aside = np.cross(along, (0, 0, 1))
    return Sphere(middle + (distance + radius) * aside / np.linalg.norm(aside), radius)


def amid(*obstacles):
    return DirectSimulator(ROD, obstacles=obstacles)


def test_beside_an_obstacle_it_moves_as_without_one(way):
    ball = beside(way, 0.01, 0.02)
    alone = Trajectory(way, LIMITS, simulator=DIRECT)
    near = Trajectory(way, LIMITS, simulator=amid(ball))
    assert near.duration == pytest.approx(alone.duration, rel=1e-12)
    assert near.motion.swing == pytest.approx(alone.motion.swing, rel=1e-9)
    assert near.motion.contact_force == 0
    report = replay(amid(ball), way, limits=LIMITS, obstacles=[ball])
    assert report.safe and 0 < report.dynamic_clearance < 0.0101
    assert report.duration == pytest.approx(alone.duration, rel=1e-9)


@pytest.fixture
def rounds(monkeypatch):
    """Return the list to which each law that is tried adds something."""
    tried, timed = [], CalmSearch._timed
    monkeypatch.setattr(CalmSearch, '_timed', lambda *given: tried.append(0) or timed(*given))
    return tried


@pytest.mark.every(2)
@pytest.mark.parametrize('radius', [2e-4, 2e-3])
def test_what_is_touched_between_two_waypoints_refuses(way, radius, rounds):
    ball = beside(way, -radius, radius)
    assert min(clearance([ball], Surface.of(ROD), shape) for shape in way.shapes) > 4e-3
    with pytest.raises(Infeasible, match='however slow it is, .* touches what') as caught:
        Trajectory(way, LIMITS, simulator=amid(ball))
    assert (caught.value.constraint, caught.value.unit) == ('contact', 'm')
    assert str(caught.value).endswith(f'(contact, by {caught.value.amount:.4g} m)')
    with pytest.raises(Infeasible, match='however slow it is') as caught:
        Trajectory(way, LIMITS, simulator=DIRECT, obstacles=[ball])
    assert caught.value.constraint == 'clearance'
    report = replay(amid(ball), way, limits=LIMITS)
    assert not report.safe and 'touches what the plan does not' in report.reason
    assert len(rounds) == 3  # one law tells that none will do


def test_what_is_touched_in_motion_alone_is_not_safe(way):
    quick = Trajectory(way, Limits(2.0, 10.0, 20.0, 100.0, np.inf, np.inf), tolerance=np.inf)
    times = np.linspace(0, quick.duration + 0.3, 200)
    motion = DIRECT.simulate(quick.at(times)[0], times[1], way.shapes[0])
    calm = DIRECT.track(quick.at(times)[0], initial=way.shapes[0])
    k = int(np.argmax([np.linalg.norm(one.positions[-1] - other.positions[-1])
                       for one, other in zip(motion.shapes, calm, strict=True)]))
    ball = Sphere(motion.shapes[k].positions[-1], 2e-3)
    assert min(clearance([ball], Surface.of(ROD), shape) for shape in calm) > 2e-3
    report = replay(amid(ball), way, trajectory=quick)
    assert report.contact_force == 0 < report.dynamic_contact_force < np.inf
    assert not report.safe and 'touches something' in report.reason


def test_a_plan_that_begins_where_it_touches_is_refused(way):
    with pytest.raises(Infeasible) as caught:
        Trajectory(way, LIMITS, simulator=amid(Sphere(way.shapes[0].positions[20], 5e-3)))
    assert caught.value.constraint == 'contact'


def swept(offset):
    """Return a straight DLO that goes along y at 1 m/s, once in 0.04 s: shapes and velocities."""
    direct = DirectSimulator(ROD, gravity=(0, 0, 0))
    still = direct.solve(Pose.identity())
    places = np.arange(-3, 4) * 0.04 + offset
    shapes = [replace(still, positions=still.positions + (0, y, 0)) for y in places]
    velocities = np.zeros((len(shapes), *still.positions.shape))
    velocities[:, :, 1] = 1.0
    return shapes, velocities


@pytest.mark.parametrize('offset', [0.0, 0.01, 0.02, 0.033])
@pytest.mark.parametrize('thin', [1e-3, 1e-5])
def test_a_thin_body_between_two_instants_is_found(offset, thin):
    post = Capsule((0.2, 0, -1), (0.2, 0, 1), thin)
    near = Bodies((), [post], Surface.of(ROD))
    assert least_between(near, *swept(offset), 0.04) <= 0


def test_a_hop_between_two_instants_is_found():
    still = DirectSimulator(ROD, gravity=(0, 0, 0)).solve(Pose.identity())
    velocities = np.zeros((2, *still.positions.shape))
    velocities[0, :, 2], velocities[1, :, 2] = 1.0, -1.0  # it rises by 0.01 m
    for height, touched in ((0.008, True), (0.013, False)):
        bar = Capsule((0.2, -1, height), (0.2, 1, height), 1e-3)
        least = least_between(Bodies((), [bar], Surface.of(ROD)), [still] * 2, velocities, 0.04)
        assert (least <= 0) == touched


@pytest.mark.parametrize('room', [1e-2, 1e-3, 1e-4])
def test_a_body_that_is_passed_closely_is_not_touched(room):
    over = 5e-4 + room + 1e-3
    bar = Capsule((0.2, 0, over), (0.4, 0, over), 1e-3)
    shapes, velocities = swept(0.017)
    least = least_between(Bodies((), [bar], Surface.of(ROD)), shapes, velocities, 0.04)
    assert least == pytest.approx(room, rel=0.05)


def test_the_least_of_many_is_the_least_of_each(way):
    ball = beside(way, 0.01, 0.02)
    shapes = DIRECT.track([*way.grippers, *way.grippers[::-1]])
    near = Bodies((), [ball], Surface.of(ROD))
    assert near.least(shapes) == min(near.exact(shape) for shape in shapes)
    assert near.exact(shapes[0]) == clearance([ball], Surface.of(ROD), shapes[0])
    assert np.isnan(Bodies((), (), Surface.of(ROD)).least(shapes))


def test_beside_a_sheet_other_bodies_count_as_well(way):
    ball, far = beside(way, 0.01, 0.02), Sphere((0.0, 5.0, 0.0), 0.1)
    sheet, surface = Sheet.around(HOLE), Surface.of(ROD)
    shape = way.shapes[1]
    own = hole_clearances(sheet, HOLE.normal, surface, shape).min()
    room = clearance([ball], surface, shape)
    assert room < own
    assert Bodies([(sheet, HOLE.normal)], [ball, sheet], surface).exact(shape) == room
    assert Bodies([(sheet, HOLE.normal)], [far], surface).exact(shape) == own


def test_of_two_motions_the_worse_figures_count():
    one, other = (InMotion(True, *np.arange(1.0, 17.0)), InMotion(False, *np.arange(2.0, 18.0)))
    least = ('clearance', 'calm_clearance', 'calm_gap', 'bend_margin')
    for worse in (one.worse(other), other.worse(one)):
        assert not worse.converged
        for item in fields(InMotion)[1:]:
            assert getattr(worse, item.name) == getattr(one if item.name in least else other,
                                                        item.name)
    unknown = replace(one, clearance=np.nan, swing=np.nan)
    assert (unknown.worse(one).clearance, unknown.worse(one).swing) == (one.clearance, one.swing)
