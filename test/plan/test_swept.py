# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is looked at between the waypoints of a plan."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Plan,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Thread,
    Trajectory,
    Workspace,
)
from dlo_planner.energy.scene import build_scene
from dlo_planner.model.rod import Surface
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.clearance import clearance, hole_clearances
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import PlanStatus, concatenate
from dlo_planner.plan.swept import violation_between
from dlo_planner.plan.workspace import distances_from

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
DIRECT = DirectSimulator(WIRE)
ALONG = np.array([0.95782629, 0.28734789, 0.0])
HOLE = CutOut(Pose.looking_along((0.3, 0.1, 1.0), ALONG), radius=0.01)
FREE = CutOut(HOLE.pose)
FEW = [0.0, 0.45, 0.9]


def thread(cutout=FREE, depths=FEW, obstacles=(), **cell):
    direct = DirectSimulator(WIRE, obstacles=obstacles)
    return InverseSimulator(direct, **cell).thread(cutout, depths=depths)


def places(plan, number=4001):
    """Return parameters (n,) and places (n, 3) of the gripper on the path of a plan."""
    path = GripperPath.of(plan)
    u = np.linspace(path.times[0], path.times[-1], number)
    return u, path.at(u)[0]


PLAN = thread()
U, WAY = places(PLAN)
LEGS = np.array([np.interp(U, PLAN.times, [pose.position[k] for pose in PLAN.grippers])
                 for k in range(3)]).T
BULGE = int(np.argmax(np.linalg.norm(WAY - LEGS, axis=1)))


def test_the_gripper_is_looked_at_on_its_way_not_on_straight_legs():
    assert np.linalg.norm(WAY[BULGE] - LEGS[BULGE]) > 0.01
    goal = int(np.searchsorted(PLAN.times, U[BULGE]))
    with pytest.raises(Infeasible) as caught:
        thread(workspace=Workspace(keep_out=[Sphere(WAY[BULGE], 2e-3)]))
    assert caught.value.constraint == 'workspace.keep_out[0]' and caught.value.waypoint == goal
    assert caught.value.amount == pytest.approx(2e-3, abs=1e-5) and len(caught.value.plan) == goal
    # where only the straight leg would hit it, it is no obstacle
    assert thread(workspace=Workspace(keep_out=[Sphere(LEGS[BULGE], 2e-3)])).fraction == 1
    # what was checked is what a trajectory does
    way = Trajectory(PLAN, tolerance=np.inf)
    moving = np.array([pose.position for pose in way.at(np.linspace(0, way.duration, 2001))[0]])
    assert np.linalg.norm(moving - WAY[BULGE], axis=1).min() < 5e-4


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('side', ['lower', 'upper'])
def test_the_box_is_kept_between_waypoints(axis, side):
    sign = 1 if side == 'upper' else -1
    most = (sign * WAY[:, axis]).max()
    for room in (1e-5, -1e-5):
        corner = np.full(3, sign * np.inf)
        corner[axis] = sign * (most + room)
        inverse = InverseSimulator(DIRECT, workspace=Workspace(**{side: corner}))
        if room > 0:
            assert inverse.check(PLAN) is PLAN
            continue
        with pytest.raises(Infeasible) as caught:
            inverse.check(PLAN)
        goal = caught.value.waypoint
        there = (PLAN.times[goal - 1] <= U) & (PLAN.times[goal] >= U)
        assert caught.value.constraint == f'workspace.{side}.{"xyz"[axis]}'
        assert caught.value.amount == pytest.approx(
            (sign * WAY[there, axis]).max() - most - room, abs=2e-6)


def random_body(rng, place):
    place = place + rng.normal(size=3) * 0.02
    pose = Pose.from_rotation(place, Rotation.from_rotvec(rng.normal(size=3)).as_matrix())
    size = rng.uniform(1e-3, 0.02)
    return [Sphere(place, size), Capsule(place, place + 0.1 * rng.normal(size=3), size),
            Box(pose, size * rng.uniform(0.5, 2, 3)), Plane(place, rng.normal(size=3)),
            Sheet(pose, 0.05, 0.08, 1e-3)][rng.integers(5)]


def test_random_bodies_against_dense_samples(rng):
    plans = [PLAN, thread(depths=np.linspace(0, 0.9, 7))]
    refused = 0
    for trial in range(40):
        plan = plans[trial % 2]
        u, way = places(plan, 8001)
        body, radius = random_body(rng, way[rng.integers(way.shape[0])]), rng.choice([2e-3, 0.02])
        scene = build_scene([body], radius)
        rooms = np.min([distances_from(scene, o, way)[0] for o in range(scene.kind.size)],
                       axis=0) - radius
        found = Workspace(keep_out=[body], gripper_radius=radius).first_beyond(GripperPath.of(plan))
        if found is None:
            assert rooms.min() > -1e-5
            continue
        refused += 1
        goal, name, amount = found
        assert name == 'workspace.keep_out[0]'
        before = u <= plan.times[goal - 1]
        there = (u >= plan.times[goal - 1]) & (u <= plan.times[goal])
        assert goal == 1 or rooms[before].min() > -1e-5
        # samples are a tenth of a millimeter apart; beside sheets a little is kept
        assert -3e-5 < amount + rooms[there].min() < 1e-4
    assert 10 < refused < 38


def test_a_gripper_that_turns_in_place_or_rides_along_a_wall_is_judged_at_once():
    turning = [Pose.from_rotation((0.3, 0.1, 1e3), Rotation.from_rotvec((0, angle, 0)).as_matrix())
               for angle in (0.0, 0.5, 1.0)]
    riding = [Pose((0.1 * k, 0.7 / 3, 0.1), (0, 0, 0, 1)) for k in range(5)]
    for grippers, wall in ((turning, Plane((0, 0.1, 1e3 + 1e-3), (0, 0.1, 1))),
                           (riding, Plane((0, 0, 0.1 + 1e-3), (0, 0, 1))),
                           (riding, Plane((0, 0, 1e6), (1e-9, 0, 1)))):
        path = GripperPath.through(grippers, range(len(grippers)), 1.0)
        scene = build_scene([wall], 0.0)
        amount = -distances_from(scene, 0, path.at(np.linspace(0, 1, 11))[0])[0].min()
        assert amount > 0
        goal, name, most = Workspace(keep_out=[wall]).first_beyond(path)
        assert (goal, name) == (1, 'workspace.keep_out[0]')
        assert most == pytest.approx(amount, rel=1e-6)
    wall = Plane((0, 0, 0.1), (0, 0, 1))  # touched all along, never entered
    assert Workspace(keep_out=[wall]).first_beyond(path) is None


def test_a_foil_is_not_gone_through_by_a_gripper_without_size():
    middle = 0.5 * (U[BULGE] + PLAN.times[1])
    position = np.array([np.interp(middle, U, WAY[:, k]) for k in range(3)])
    foil = Sheet(Pose.looking_along(position, ALONG), 0.2, 0.2, 0.0)
    with pytest.raises(Infeasible, match='keep_out'):
        thread(workspace=Workspace(keep_out=[foil]))
    beside = replace(foil, pose=Pose.looking_along(position + (0, 0, 0.3), ALONG))
    assert thread(workspace=Workspace(keep_out=[beside])).fraction == 1


def moved(plan, number):
    """Return parameters and the shapes of the DLO in slow motion on the path of a plan."""
    u = np.linspace(plan.times[0], plan.times[-1], number)
    poses = zip(*GripperPath.of(plan).at(u), strict=True)
    return u, DIRECT.track([Pose.from_rotation(*pose) for pose in poses])


@pytest.mark.every(2)
@pytest.mark.parametrize('depths', [FEW, np.linspace(0, 0.9, 4), np.linspace(0, 0.9, 5),
                                    np.linspace(0, 0.9, 9)])
def test_the_dlo_in_the_hole_between_waypoints(depths):
    plan = thread(depths=depths)  # the same without a size: it is not looked at
    u, shapes = moved(plan, 161)
    sheet = Sheet.around(HOLE, 100.0, 100.0, 0.0)
    rooms = np.array([hole_clearances(sheet, HOLE.normal, WIRE.radius, shape).min()
                      for shape in shapes])
    if rooms.min() > 0:
        assert thread(HOLE, depths).fraction == 1
        return
    with pytest.raises(Infeasible) as caught:
        thread(HOLE, depths)
    goal = caught.value.waypoint
    assert goal == np.searchsorted(plan.times, u[np.argmax(rooms < 0)])
    assert caught.value.constraint == 'clearance' and len(caught.value.plan) == goal
    there = (u > plan.times[goal - 1]) & (u <= plan.times[goal])
    assert caught.value.amount == pytest.approx(-rooms[there].min(), rel=0.1)


def test_a_bent_dlo_that_is_drawn_along_itself_goes_straight_between_waypoints():
    # weightless it is an arc, and slides along it from one waypoint to the other: the gripper,
    # which goes straight, takes it 13 mm off that arc
    bent = Rod(0.6, 0.06, 0.005, 0.003, natural_curvature=(0.0, 0.4), radius=4e-3)
    inverse = InverseSimulator(DirectSimulator(bent, gravity=(0, 0, 0), basis='local'))
    hole = CutOut(Pose.looking_along((0, 0, 0), (1, 0, 0)), radius=0.01)
    with pytest.raises(Infeasible, match='on the way there') as refused:
        inverse.thread(hole, depths=[0.0, 0.5])
    assert refused.value.waypoint == 1
    assert refused.value.amount == pytest.approx(0.4 * 0.5**2 / 8 - 0.006, rel=0.1)
    assert len(inverse.thread(hole, depths=np.linspace(0, 0.5, 11))) == 11


def test_the_sheet_around_a_hole_is_the_one_among_the_obstacles():
    sheet = Sheet.around(HOLE, thickness=0.03)
    depths = np.linspace(0, 0.9, 12)
    thin, plan = thread(HOLE, depths), thread(HOLE, depths, [sheet])
    assert plan.sheets[0][0] is sheet
    assert plan.clearances[1:, 0, 0].min() < thin.clearances[1:, 0, 0].min() - 1e-4


def test_an_obstacle_that_the_dlo_only_meets_between_waypoints(rng):
    plan = thread(depths=np.linspace(0, 0.9, 4))
    u, shapes = moved(plan, 31)
    touched = free = 0
    for _ in range(25):
        body = Sphere(shapes[rng.integers(31)].at(rng.uniform(0.1, 0.9)).position
                      + rng.normal(size=3) * 0.02, 5e-3)
        rooms = np.array([clearance([body], WIRE.radius, shape) for shape in shapes])
        try:
            thread(depths=np.linspace(0, 0.9, 4), obstacles=[body])
            free += 1
            assert rooms.min() > 0
        except Infeasible as error:
            assert error.constraint == 'clearance' and error.amount > 0
            # samples may miss the deepest place, and it is refused what is nearly touched
            assert rooms.min() < 2e-3
            touched += rooms[::10].min() > 0  # at no waypoint
    assert touched > 3 and free > 3


def test_who_asks_whether_something_is_touched_alone_is_told_sooner(monkeypatch):
    plan = thread(depths=np.linspace(0, 0.9, 4))
    _, shapes = moved(plan, 31)
    place = shapes[14].at(0.5).position  # between two waypoints, near the middle of their way
    demands = PlanChecker((0.1, 0.5), obstacles=(Sphere(place, 5e-3),), surface=Surface.of(WIRE),
                          simulator=DIRECT)
    track, asked = DirectSimulator.track, []
    monkeypatch.setattr(DirectSimulator, 'track', lambda *given, **how: (
        asked.append(1), track(*given, **how))[1])

    def told(says_how_deep):
        asked.clear()
        broken = violation_between(GripperPath.of(plan), plan.shapes, (), replace(
            demands, says_how_deep=says_how_deep))
        return broken, len(asked)
    (deepest, many), (somewhere, few) = told(True), told(False)
    assert few < many / 2 and somewhere.place == deepest.place
    assert deepest.room <= somewhere.room < 0


def test_a_dlo_that_falls_between_waypoints_is_refused(monkeypatch):
    inverse = InverseSimulator(DIRECT)
    track = DirectSimulator.track

    def falling(self, grippers, progress=None, initial=None, **more):
        return [replace(shape, jumped=True)
                for shape in track(self, grippers, progress, initial, **more)]

    plan = thread(depths=np.linspace(0, 0.9, 4))
    path = replace(plan, sheets=((Sheet.around(HOLE), HOLE.normal),))
    monkeypatch.setattr(DirectSimulator, 'track', falling)
    with pytest.raises(Infeasible, match='snaps into another shape') as caught:
        inverse.check(path)
    assert caught.value.constraint == 'continuity' and caught.value.amount > 0


def test_joined_and_shortened_plans_are_checked_again():
    inverse = InverseSimulator(DIRECT)
    plan = inverse.thread(HOLE)
    start = Pose.looking_along(HOLE.center - 1.3 * ALONG + (0, 0.2, 0.1), ALONG)
    both = concatenate(inverse.approach(HOLE, plan, start, standoff=0.05), plan)
    assert inverse.check(both) is both
    u, way = places(both)
    ball = Sphere(way[len(u) // 5], 1e-3)
    with pytest.raises(Infeasible) as caught:
        InverseSimulator(DIRECT, workspace=Workspace(keep_out=[ball])).check(both)
    assert caught.value.constraint == 'workspace.keep_out[0]'
    assert caught.value.waypoint == np.searchsorted(both.times, u[len(u) // 5])
    body = Sphere(both.shapes[-2].positions[-1], 2e-3)  # the DLO is in it, the gripper far off
    with pytest.raises(Infeasible) as caught:
        InverseSimulator(DirectSimulator(WIRE, obstacles=[body])).check(both)
    assert caught.value.constraint == 'clearance'


def test_a_threading_that_ends_before_the_sheet_is_checked_again(monkeypatch):
    checked, inverse = [], InverseSimulator(DIRECT)
    monkeypatch.setattr('dlo_planner.inverse.tasks.thread.kept_between',
                        lambda plan, demands: checked.append(plan) or plan)
    whole = inverse.plan(Thread(HOLE))
    assert checked == []
    away = float((HOLE.center - whole.grippers[-2].position) @ HOLE.normal)
    plan = inverse.plan(Thread(HOLE, gripper_clearance=away - 1e-6))
    assert len(plan) == len(whole) - 1
    assert len(checked) == 1 and checked[0] is plan


def test_nothing_is_looked_at_where_nothing_is(monkeypatch):
    def untouchable(*_, **__):
        raise AssertionError

    inverse = InverseSimulator(DIRECT)
    monkeypatch.setattr(DirectSimulator, 'track', untouchable)
    assert inverse.thread(HOLE, depths=np.linspace(0, 0.9, 40), max_misalignment=0).fraction == 1


def rotated(place, *turn):
    return Pose.from_rotation(place, Rotation.from_rotvec(turn).as_matrix())


def by_hand(direct, grippers):
    """Return a Plan of gripper poses, one second apart."""
    n = len(grippers)
    return Plan(np.zeros(n), grippers, direct.track(grippers), np.zeros(n), np.zeros(n),
                np.arange(float(n)), [()] * n, np.zeros((n, 0, 3)), (), 1.0, PlanStatus.COMPLETE)


STIFF = DirectSimulator(Rod(1.0, 0.01, 50.0, 40.0, radius=1e-6), gravity=(0, 0, 0), n_elements=64)


def upright(load, turn):
    """Return a DLO that is so soft against its weight, and its plan: it bends over."""
    direct = DirectSimulator(Rod(1.0, load / 9.81, 1.0, 0.8, radius=1e-6), n_elements=64)
    return direct, [rotated((0, 0, 0), 0, sign * turn - np.pi / 2, 0) for sign in (-1, 1)]


def swung(turn, roll):
    """Return the pose of a gripper that is turned to the side, after a roll about the DLO."""
    return Pose.from_rotation((0, 0, 0), Rotation.from_euler('ZX', (turn, roll)).as_matrix())


@pytest.mark.parametrize(('case', 'share', 's'), [
    # the tip goes along an arc: it is farther out than half way between both ends
    (lambda: (STIFF, [rotated((0, 0, 0), 0, 0, turn) for turn in (-0.6, 0.6)]), 0.5, 1.0),
    # the gripper's path bulges
    (lambda: (STIFF, [Pose((0, 0.3 * k, 0.1 * (k % 2)), (0, 0, 0, 1)) for k in range(3)]),
     19 / 80, 0.0),
    # the path of its turns does: between two shapes in one place it swings out
    (lambda: (STIFF, [swung(turn, 0.4 * k) for k, turn in enumerate((0, 0.6, 0.6, 0))]), 0.5, 1.0),
    # a DLO that hardly stands moves by more than it is turned: by four times, by eight
    (lambda: upright(5.5, 0.1), 0.5, 1.0), (lambda: upright(6.5, 0.05), 0.5, 0.9),
    (lambda: upright(6.5, 0.1), 0.5, 1.0), (lambda: upright(6.5, 0.2), 0.5, 0.9)])
def test_what_bulges_out_between_two_shapes_is_not_proved_away(case, share, s):
    direct, grippers = case()
    plan = by_hand(direct, grippers)
    path = GripperPath.of(plan)
    ways = path.at(share * path.times[-1] * np.linspace(0, 1, 11))
    shape = direct.track([Pose.from_rotation(*one) for one in zip(*ways, strict=True)])[-1]
    body = Sphere(shape.at(s).position, 1e-6)  # in its axis
    assert min(clearance([body], 1e-6, one) for one in plan.shapes) > 0.05
    around = DirectSimulator(direct.rod, gravity=direct.gravity, n_elements=64, obstacles=[body])
    with pytest.raises(Infeasible) as caught:
        InverseSimulator(around).check(plan)
    goal = path.goal(share * path.times[-1])
    assert (caught.value.constraint, caught.value.waypoint) == ('clearance', goal)
    beside = replace(body, center=body.center + (0.0, 0.0, 3.0))
    assert InverseSimulator(DirectSimulator(direct.rod, gravity=direct.gravity, n_elements=64,
                                            obstacles=[beside])).check(plan) is plan
