# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What happens to the cell on the way: as stated, and no longer than stated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from benchmarks.cell.drivers import PERIOD, OpenLoop  # noqa: E402
from benchmarks.cell.run import SEEN_CELLS, Outcome, Stay, run  # noqa: E402
from benchmarks.cell_trust import said  # noqa: E402
from dlo_planner import CutOut, InvalidTask, Pose, Rod  # noqa: E402  mujoco may be missing
from dlo_planner.cell.camera import Camera  # noqa: E402
from dlo_planner.cell.cases import strikes_inside  # noqa: E402
from dlo_planner.cell.disturbances import Bump, Disturbances, Kink, Slip  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402
from dlo_planner.cell.robot import nearer  # noqa: E402
from dlo_planner.cell.tasks import Task  # noqa: E402
from dlo_planner.cell.truth import VERY_UNCERTAIN, Truth, Unknowns  # noqa: E402

BAR = Rod(0.4, 0.05, 20.0, 15.0, radius=3e-3)  # so stiff that it goes where the gripper goes
WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
LEVEL = Pose((-0.45, 0.0, 1.0), (0, 0, 0, 1))
TILTED = Pose.looking_along((0, 0, 1), (1, 0.5, 0.2))
FAR = Pose((-1.3, 0.0, 1.0), (0, 0, 0, 1))
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
TASK = Task('bar', BAR, HOLE, LEVEL, 0.2)


def drawn(seed=0, **disturbances):
    return Disturbances(**disturbances).draw(np.random.default_rng(seed))


def seen(*args, **options):
    """Return the Outcome of a run with a camera: a coarse chain, and no second one."""
    return run(*args, camera=options.pop('camera', Camera()), **options)


def still(seconds=1.0, **attributes):
    """Return a driver that stands still, and what it was given, (time, gripper, images)."""
    given = []

    def driver(task):
        def command(images, time, gripper):
            given.append((time, gripper, images))
            return task.start if time < seconds - 0.5 * PERIOD else None
        vars(command).update(attributes)
        return command
    return driver, given


def test_the_robot_wanders_as_far_and_as_slowly_as_stated():
    course, times = drawn(wander_position=0.7e-3, wander_rotation=2.5e-3), np.arange(0, 4000, 0.1)
    shifts, turns = map(np.array, zip(*(
        course.robot_error(TILTED.position, TILTED.rotation, time) for time in times), strict=True))
    assert np.sqrt((shifts**2).mean(axis=0)) == pytest.approx(np.full(3, 0.7e-3), rel=0.03)
    assert np.sqrt((turns**2).mean(axis=0)) == pytest.approx(np.full(3, 2.5e-3), rel=0.03)
    power = np.abs(np.fft.rfft(shifts[:, 0])) ** 2
    of_it = (frequencies := np.fft.rfftfreq(times.size, 0.1)) > 0.045
    assert power[of_it & (frequencies < 0.305)].sum() > 0.99 * power.sum()
    other = drawn(1, wander_position=0.7e-3)
    assert np.abs(np.subtract(*(one.robot_error(TILTED.position, TILTED.rotation, 3.0)[0]
                                for one in (course, other)))).max() > 1e-5


def test_the_robot_errs_by_its_pose_smoothly_and_as_far_as_stated():
    moved = LEVEL.compose(Pose((0, 0.4, 0), (0, 0, 0, 1)))
    turned = LEVEL.compose(Pose((0, 0, 0), Rotation.from_rotvec((0, 0, 0.5)).as_quat()))
    near = LEVEL.compose(Pose((0.01, 0, 0), (0, 0, 0, 1)))
    courses = [drawn(seed, robot_position=0.7e-3, robot_rotation=2.5e-3) for seed in range(600)]
    first, far, other, close = (np.array([np.concatenate(course.robot_error(
        pose.position, pose.rotation, time)) for course in courses]) / np.repeat(
        [0.7e-3, 2.5e-3], 3) for pose, time in zip((LEVEL, moved, turned, near), range(4),
                                                   strict=True))
    assert np.sqrt((first**2).mean(axis=0)) == pytest.approx(np.ones(6), abs=0.1)
    # exp(-(way / 0.4 m)^2 / 2); a turn is the way of two axes at 0.25 m
    for there, way in ((far, 0.4), (other, 0.25 * 2**1.5 * np.sin(0.25))):
        assert (first * there).mean() == pytest.approx(np.exp(-0.5 * (way / 0.4) ** 2), abs=0.06)
    assert np.sqrt(((close - first)**2).mean()) == pytest.approx(0.01 / 0.4, rel=0.1)


def test_the_plant_is_where_the_robot_truly_is_and_measures_another_pose():
    course = drawn(robot_position=3e-3, robot_rotation=0.01, wander_position=3e-3,
                   wander_rotation=0.01)
    truth = Truth(gripper_shift=(1e-3, 0, 0), gripper_turn=(0, 0, 0.01))
    plant = Plant(BAR, TILTED, cells=8, gravity=(0, 0, 0), damping=1.0, course=course, truth=truth)
    for _ in range(300):
        plant.move(TILTED, 0.01)
    begins = TILTED.rotation @ Rotation.from_rotvec((0, 0, 0.01)).as_matrix()
    place = TILTED.position + TILTED.rotation @ (1e-3, 0, 0)
    shift, turn = course.robot_error(place, begins, plant.time)
    assert np.linalg.norm(shift) > 1e-3
    place = place + begins @ shift
    assert plant.points([0.0])[0] == pytest.approx(place, abs=1e-9)
    along = begins @ Rotation.from_rotvec(turn).as_matrix()[:, 0]
    assert plant.tip.position == pytest.approx(place + 0.4 * along, abs=1e-4)
    assert plant.measured == TILTED


def test_a_slip_moves_and_turns_the_dlo_in_the_grip_once():
    bent = Rod(0.4, 0.05, 20.0, 15.0, natural_curvature=(0.0, 1.0))
    course = drawn(slips=[Slip(0.1, back=2e-3, turn=(0.3, 0, 0))])
    plant = Plant(bent, TILTED, cells=20, gravity=(0, 0, 0), damping=1.0, course=course)

    def tip():
        return TILTED.rotation.T @ (plant.tip.position - TILTED.position)

    before = tip()
    plant.move(TILTED, 0.1)
    assert tip() == pytest.approx(before, abs=1e-9)
    for _ in range(5):
        plant.move(TILTED, 0.01)
    assert TILTED.rotation.T @ (plant.points([0.0])[0] - TILTED.position) == pytest.approx(
        (-2e-3, 0, 0), abs=1e-12)
    for _ in range(100):
        plant.move(TILTED, 0.01)
    turned = Rotation.from_rotvec((0.3, 0, 0)).apply(before)
    assert np.linalg.norm(turned - before) > 0.02
    assert tip() == pytest.approx(turned - (2e-3, 0, 0), abs=1e-6)


def test_a_kink_bends_the_dlo_for_good_at_its_place():
    kink = Kink(0.1, 0.02, 0.5, np.pi / 2)
    course = replace(drawn(kinks=(kink,)), since=0.0)
    plant = Plant(BAR, LEVEL, gravity=(0, 0, 0), cells=20, course=course, damping=0.5)
    s = np.linspace(0, 0.4, 9)
    before = plant.points(s)
    assert kink.bend(0.05).tolist() == [0.0, 0.0]
    for _ in range(60):
        plant.move(LEVEL, 0.01)
    moved = np.linalg.norm(plant.points(s) - before, axis=1)
    # a joint in the middle of a cell of 20 mm: the free half turns by the angle about the b axis
    assert moved[s < 0.2].max() < 1e-5
    assert moved[-1] == pytest.approx(0.02 * 0.19, rel=0.01)
    assert np.abs(plant.points(s) - before)[-1].argmax() == 1
    assert course.times == (0.1,)


def test_sheets_are_elsewhere_by_what_is_stated():
    moved = seen(TASK, still(0.1)[0], disturbances=Disturbances(sheets_shift=(0, 4e-3, 0)),
                 camera=Camera(sees_hole=True, noise=0.0))
    assert not moved.refused
    driver, given = still(0.5)
    seen(TASK, driver, disturbances=Disturbances(sheets_shift=(0, 4e-3, 0)),
         camera=Camera(sees_hole=True, noise=0.0))
    holes = [image.hole for *_, images in given for image in images]
    np.testing.assert_allclose(holes, np.tile(HOLE.center + (0, 4e-3, 0), (len(holes), 1)))


def test_what_strikes_inside_is_told_from_what_happens_before_and_after():
    course = drawn(slips=(Slip(3.0, 1e-3, (0, 0, 0)),), bumps=(Bump(9.0, 0.01, (0, 1, 0), 1.0),))
    assert course.times == (3.0, 9.0)
    assert replace(course, since=2.0).times == (5.0, 11.0)
    assert replace(course, since=np.inf).times == (np.inf, np.inf)
    assert [strikes_inside(course.times, *stay) for stay in (
        (4.5, 8.0), (3.5, 8.0), (4.5, 9.5), (9.9, 20.0), (10.1, 20.0))] == [
            False, True, True, True, False]


def test_nothing_happens_before_it_may():
    bump, slip = Bump(0.1), Slip(0.1, back=2e-3)
    waiting = replace(drawn(bumps=[bump], slips=[slip]), since=np.inf)
    assert waiting.in_grip(1e3)[0] == 0
    assert waiting.push(bump, 1e3) == 0
    later = replace(waiting, since=5.0)
    assert [later.in_grip(time)[0] for time in (5.1, 5.15)] == pytest.approx([0, 2e-3])
    assert [later.push(bump, time) for time in (5.09, 5.3, 5.51)] == pytest.approx([0, 1, 0])


@pytest.mark.every(3)
@pytest.mark.parametrize(('place', 'aside'), [(1.0, (0, 1, 0)), (0.5, (0, 1, 0)),
                                              (1.0, (0.3, 0.2, 1)), (1.0, (0.6, 0.3, -1))])
def test_a_bump_displaces_by_as_much_as_stated_and_ends(place, aside):
    bump = Bump(0.2, 0.01, aside, place)
    plants = [Plant(WIRE, TILTED, cells=20, step=4e-3, damping=0.05, course=course)
              for course in (None, drawn(bumps=[bump]))]
    at, away, along = min(place, 1 - 0.25 / 20), [], []
    for _ in range(200):
        for plant in plants:
            plant.move(TILTED, 0.02)
        away.append(np.linalg.norm(plants[1].points([at]) - plants[0].points([at])))
        force = plants[1]._data.xfrc_applied[:, :3].sum(axis=0)
        along.append(force @ plants[0].tip.direction / (np.linalg.norm(force) or 1))
    assert max(away[:10]) == 0
    assert max(away) == pytest.approx(0.01, rel=0.05)
    assert max(away[-40:]) < 0.6 * max(away)
    assert not plants[1]._data.xfrc_applied.any()
    assert max(np.abs(along)) < 0.03 or place < 1  # it pushes across, whatever its direction


@pytest.mark.parametrize(('rate', 'lag'), [(3.0, 1e-3), (2 * np.pi / 0.4, 1e-4), (60.0, 0.01),
                                           (40.0, 0.05), (400.0, 0.1)])  # critical, creeping
def test_an_oscillator_that_is_bumped(rate, lag):
    bump = Bump(0.0)
    found = bump.response(np.array([rate]), lag)[0]
    times = np.linspace(0, 0.4 + np.pi / rate, found.size)
    moved = solve_ivp(lambda t, y: (y[1], bump.profile(t) - rate**2 * (y[0] + lag * y[1])),
                      (0, times[-1]), (0, 0), 'Radau', times, rtol=1e-8, atol=1e-12, max_step=0.01)
    assert found == pytest.approx(moved.y[0], abs=1e-4 * np.abs(found).max())


def test_a_robot_with_a_lag_is_behind_and_the_driver_measures_it():
    def driver(task):
        def command(images, time, gripper):
            behind.append(0.1 * time - (gripper.position - task.start.position)[1])
            return Pose(task.start.position + (0, 0.1 * (time + PERIOD), 0), (0, 0, 0, 1)) if (
                time < 1) else None
        return command

    behind, places = [], []
    seen(TASK, driver, disturbances=Disturbances(lag=0.05), watch=lambda plant: places.append(
        plant.points([0.0])[0, 1]))
    assert behind[0] == 0
    assert behind[-1] == pytest.approx(0.1 * 2 * 0.05, abs=0.1 * PERIOD)  # two stages
    assert places[-1] == pytest.approx(0.1 * 1.0 - behind[-1], abs=1e-3)
    behind.clear()
    seen(TASK, driver)
    assert np.abs(behind).max() < 1e-9


@pytest.mark.parametrize('share', [0.0, 0.3, 1.0])
@pytest.mark.parametrize('turn', [(0, 0, 0), (1e-9, 0, 0), (0.1, -0.2, 0.3), (2.0, 1.0, 2.0)])
def test_a_part_of_the_way_between_two_poses(share, turn):
    other = Pose.from_rotation((1, 2, 4), Rotation.from_rotvec(turn).as_matrix() @ TILTED.rotation)
    for end in (other, Pose(other.position, -other.quaternion)):
        found = nearer(TILTED, end, share)
        assert found.position == pytest.approx(np.multiply(share, (1, 2, 4))
                                               + (1 - share) * TILTED.position)
        assert found.rotation == pytest.approx(
            Rotation.from_rotvec(np.multiply(share, turn)).as_matrix() @ TILTED.rotation, abs=1e-12)


def test_computing_takes_the_time_that_is_declared():
    def driver(task):
        def command(images, time, gripper):
            calls.append((time, gripper.position[1], len(images)))
            command.busy = 0.5 if len(calls) == 2 else 0.0
            return Pose(task.start.position + (0, 1e-3 * len(calls), 0), (0, 0, 0, 1)) if (
                len(calls) < 5) else None
        return command

    calls, places = [], []
    outcome = seen(TASK, driver, camera=Camera(rate=20.0, latency=0.0), watch=lambda plant: (
        places.append(plant.measured.position[1])))
    assert places == pytest.approx([1e-3] * 51 + [2e-3, 3e-3, 4e-3])
    assert [time for time, *_ in calls] == pytest.approx([
        0, PERIOD, 0.5 + 2 * PERIOD, 0.5 + 3 * PERIOD, 0.5 + 4 * PERIOD])
    assert [place for _, place, _ in calls] == pytest.approx([0, 1e-3, 2e-3, 3e-3, 4e-3])
    assert [count for *_, count in calls] == [1, 0, 10, 0, 0]
    assert outcome.time == pytest.approx(0.5 + 4 * PERIOD)


def test_the_driver_knows_what_is_stated_and_no_more():
    told = []

    def driver(task):
        told.append(task.rod)
        return still(0.02)[0](task)

    for seed in range(3):
        for unknowns in (Unknowns(), Unknowns(damping=0.5)):
            seen(replace(TASK, rod=WIRE, depth=0.1, start=FAR), driver, seed=seed,
                unknowns=unknowns, damping=0.05)
    assert {replace(rod, damping=(0.0, 0.0)) for rod in told} == {WIRE}
    lag = Plant(WIRE, FAR, cells=SEEN_CELLS, step=2e-3, damping=0.05).lag
    assert [rod.damping for rod in told] == [(0.0, pytest.approx(lag, rel=1e-6))] * 6
    true = [VERY_UNCERTAIN.draw(np.random.default_rng(seed)).damping for seed in range(400)]
    assert np.std(np.log(true)) == pytest.approx(0.35, rel=0.1)
    assert np.median(true) == pytest.approx(1, abs=0.07)


@pytest.mark.sweep
def test_the_sheet_rubs_where_that_is_stated():
    def driver(task):  # on to the sheet, then aside
        at = task.start.position
        way = [(min(k, 100) * 1.5e-4, max(k - 100, 0) * 1e-4, 0) for k in range(250)]
        poses = iter([Pose(at + x, (0, 0, 0, 1)) for x in way])
        return lambda *_: next(poses, None)

    thin = Task('thin', Rod(0.4, 1e-3, 2e-3, 1.5e-3, radius=3e-3), HOLE, Pose(
        (-0.415, 0.0, 0.95), (0, 0, 0, 1)), 0.2)
    aside = []
    for friction in (0.0, 0.8):
        tips = []
        seen(thin, driver, damping=0.5, disturbances=Disturbances(friction=friction),
            watch=lambda plant, tips=tips: tips.append(plant.tip.position[1]))
        aside.append(tips[-1])
        assert len(tips) == 250
    assert aside == pytest.approx([0.0149, 0.0], abs=2e-3)


def test_the_promise_is_the_one_before_the_hole():
    def driver(task):
        def command(images, time, gripper):
            command.promised = 1e-3 if gripper.position[0] < -0.4 else 1.0
            forth = 0.3 * min(time, 1.0)
            return Pose(task.start.position + (forth, 0, 0), (0, 0, 0, 1)) if time < 1.1 else None
        return command

    through = seen(replace(TASK, start=Pose((-0.45, 2e-3, 1.0), (0, 0, 0, 1))), driver)
    assert through.threaded
    assert through.promised == 1e-3
    assert said(through)['covered'] is False


def test_each_stay_in_the_hole_has_its_promise():
    def driver(task):
        def command(images, time, gripper):
            command.promised = 1e-3 if time < 1.5 else 1.0
            forth = 0.3 * min(time, 2 - min(time, 2.0), 1.0) + 0.3 * max(time - 2, 0.0)
            return Pose(task.start.position + (forth, 0, 0), (0, 0, 0, 1)) if time < 3.1 else None
        return command

    outcome = seen(replace(TASK, start=Pose((-0.45, 2e-3, 1.0), (0, 0, 0, 1))), driver)
    first, second = outcome.stays
    assert 0 < first.begin < first.end < second.begin < second.end
    assert [stay.promised for stay in outcome.stays] == [1e-3, 1.0]
    assert outcome.miss == pytest.approx(max(first.miss, second.miss), rel=1e-6)  # straight in
    assert (outcome.promised, said(outcome)['covered']) == (1e-3, False)


def test_what_is_promised_of_a_slanted_dlo_is_judged_across_it():
    slanted = CutOut(Pose.looking_along(TASK.cutout.center, (np.cos(0.6), np.sin(0.6), 0)),
                     radius=TASK.radius)

    def driver(task):
        def command(images, time, gripper):
            forth = Pose(task.start.position + (0.3 * time, 0, 0), (0, 0, 0, 1))
            return forth if time < 1.0 else None
        command.promised = 2.2e-3
        return command

    start = Pose((-0.45, 2e-3, 1.0), (0, 0, 0, 1))
    outcome = seen(replace(TASK, start=start, cutout=slanted), driver)
    stay, = outcome.stays
    assert stay.miss == pytest.approx(2e-3, rel=0.01)
    assert outcome.miss == pytest.approx(2e-3 / np.cos(0.6), rel=0.01)
    assert said(outcome)['covered']


def test_what_it_pushes_before_the_hole_is_told_from_what_it_touches_in_it():
    def driver(task):
        def command(images, time, gripper):
            aside = max(time - 1.5, 0.0) * task.start.position[1]  # in the hole it goes to the rim
            forth = Pose(task.start.position + (0.3 * min(time, 1.0), -20 * aside, 0), (0, 0, 0, 1))
            return forth if time < 3.0 else None
        return command

    inside, before = (seen(replace(TASK, start=Pose((-0.45, y, 1.0), (0, 0, 0, 1))), driver)
                      for y in (1e-3, 0.03))
    assert inside.touched
    assert not inside.pushes
    assert inside.pushed < 1e-9
    assert before.pushes
    assert before.pushed == before.force
    assert before.depth == 0


def test_a_wild_motion_is_no_refusal():
    poses = [LEVEL, Pose((1e9, 0, 0), (0, 0, 0, 1)), LEVEL]
    outcome = seen(TASK, OpenLoop(lambda _: poses))
    assert outcome.rammed
    assert not outcome.refused
    assert not outcome.threaded


def test_a_run_has_a_robot_of_its_own_by_its_seed():
    def ended(seed, size=2e-3):
        places = []
        seen(TASK, still(0.1)[0], seed=seed, disturbances=Disturbances(size), watch=lambda plant: (
            places.append(plant.points([0.0])[0])))
        return places[-1]

    assert ended(0, 0.0) == pytest.approx(LEVEL.position, abs=1e-9)
    assert ended(0) == pytest.approx(ended(0), abs=0)
    assert 1e-4 < np.linalg.norm(ended(0) - LEVEL.position) < 0.01
    assert np.linalg.norm(ended(0) - ended(1)) > 1e-4


def test_what_is_clean_rammed_and_covered():
    def outcome(force=0.0, miss=1e-3, promised=2e-3, threaded=True):
        return Outcome(0, '', threaded, miss=miss, promised=promised, force=force,
                       stays=(Stay(1.0, 2.0, miss, promised),) if np.isfinite(miss) else ())

    assert outcome().clean
    assert not outcome(threaded=False).clean
    assert not outcome(force=0.2).clean
    assert [outcome(force=force).rammed for force in (0.9, 1.1, np.inf)] == [False, True, True]
    assert [said(one)['covered'] for one in (
        outcome(), outcome(miss=2.1e-3), outcome(miss=np.nan), outcome(promised=np.nan))] == [
            True, False, None, None]


def test_what_the_driver_says_of_itself():
    driver, given = still(0.1, phase='look', promised=0.5)
    outcome = seen(TASK, driver)
    assert (outcome.phase, outcome.promised) == ('look', 0.5)
    assert [gripper for _, gripper, _ in given] == [LEVEL] * len(given)
    assert seen(TASK, still(0.1)[0]).phase == ''


@pytest.mark.parametrize(('make', 'named'), [
    (lambda: Slip(-1.0), 'Slip.time'), (lambda: Slip(1.0, np.nan), 'Slip.back'),
    (lambda: Bump(0.0, place=1.1), 'Bump.place'), (lambda: Bump(0.0, duration=0), 'Bump.duration'),
    (lambda: Bump(0.0, direction=(0, 0, 0)), 'Bump.direction'),
    (lambda: Disturbances(lag=-1), 'Disturbances.lag'),
    (lambda: Disturbances(slips=[1]), r'Disturbances.slips\[0\]'),
    (lambda: Disturbances(robot_position=np.inf), 'Disturbances.robot_position'),
    (lambda: run(TASK, still()[0], disturbances=1), 'disturbances'),
    (lambda: run(TASK, still(busy=-1.0)[0]), 'busy'),
    (lambda: Plant(BAR, LEVEL, cells=4, course=Disturbances()), 'course')])
def test_what_makes_no_sense_is_refused(make, named):
    with pytest.raises(InvalidTask, match=named):
        make()
