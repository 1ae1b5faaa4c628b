# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of what the closed loop does when something goes wrong."""

import json

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='the cell needs mujoco (extra `cell`)')

from benchmarks import cell_trust  # noqa: E402
from benchmarks.cell import other_tasks  # noqa: E402
from benchmarks.cell.run import Outcome, Stay  # noqa: E402
from dlo_planner import (  # noqa: E402
    DirectSimulator,  # noqa: E402
    Infeasible,
    InvalidTask,
)
from dlo_planner.cell.camera import BAD  # noqa: E402
from dlo_planner.cell.cases import CASES, FAULTS, JOINED, NOMINAL, case  # noqa: E402
from dlo_planner.plan.clearance import clearance  # noqa: E402


def one(name='slip', refused='', **outcome):
    """Return what came of a run, in which something happened at 3 s."""
    if 'promised' in outcome:
        outcome.setdefault('stays', (Stay(10.0, 20.0, outcome['miss'], outcome['promised']),))
    return {'case': name, 'seed': 0, 'event_s': 3.0, 'happened': True, 'cpu_s': 2.0, 'error': '',
            **cell_trust.said(Outcome(0, refused, **outcome), [3.0])}


def test_cases_are_what_is_stated():
    drawn = {name: [case(name, seed) for seed in range(40)] for name in CASES}
    assert all(drawn[name] == [case(name, seed) for seed in range(40)] for name in CASES)
    assert drawn['nominal'] == [(NOMINAL, BAD)] * 40
    slips = [disturbed.slips[0] for disturbed, _ in drawn['slip']]
    small = [disturbed.slips[0] for disturbed, _ in drawn['small slip']]
    for found, back, degrees in ((slips, 2e-3, 1.0), (small, 5e-4, 0.29)):
        assert {slip.back for slip in found} == {back}
        turns = np.degrees([np.atleast_1d(slip.turn) for slip in found])
        assert np.linalg.norm(turns, axis=1) == pytest.approx(np.full(40, degrees))
        assert turns.min() < 0 < turns.max()
    bumps = [disturbed.bumps[0] for disturbed, _ in drawn['bump']]
    assert {(bump.displacement, bump.duration) for bump in bumps} == {(0.01, 0.4)}
    assert {bump.place for bump in bumps} == {0.5, 1.0}
    times = [one.time for one in slips + small + bumps]
    assert 2 <= min(times) < 4
    assert 18 < max(times) <= 20
    assert all(d.wander_position == 2 * NOMINAL.robot_position
               and d.wander_rotation == 2 * NOMINAL.robot_rotation for d, _ in drawn['wandering'])
    assert {camera.blind for _, camera in drawn['hidden']} == {0.3}
    assert {camera.second_cable for _, camera in drawn['second cable']} == {0.2}
    with pytest.raises(InvalidTask, match='name'):
        case('rain', 0)


def test_faults_are_what_is_stated_by_themselves_and_together():
    drawn = {name: [case(name, seed) for seed in range(10)] for name in FAULTS}
    assert all(drawn[name] == [case(name, seed) for seed in range(10)] for name in FAULTS)
    assert {disturbed.kinks[0].angle for disturbed, _ in drawn['kink']} == {0.02}
    assert all(d.kinks[0].time == d.bumps[0].time for d, _ in drawn['kink'])
    assert all(camera.fills_in and camera.blind == 0.3 for _, camera in drawn['filled in'])
    for name, value, size in (('turned camera', lambda d, c: c.turn, np.radians(0.5)),
                              ('biased camera', lambda d, c: c.offset, 3e-3),
                              ('drifting camera', lambda d, c: 60 * c.drift, 1e-3),
                              ('drifting camera', lambda d, c: 60 * c.turn_drift,
                               np.radians(0.1)),
                              ('moved hole', lambda d, c: d.sheets_shift, 4.5e-3)):
        sizes = [np.linalg.norm(value(*one)) for one in drawn[name]]
        assert sizes == pytest.approx([size] * 10)
    assert {camera.stamp_error for _, camera in drawn['late stamps']} == {-0.1, 0.1}
    assert all(camera.sees_hole for _, camera in drawn['moved hole'])
    disturbed, camera = case(f'kink{JOINED}biased camera', 3)
    assert disturbed.kinks
    assert np.linalg.norm(camera.offset) == pytest.approx(3e-3)
    for wrong in ('rain', 'nominal'):  # which is not wrong by itself
        with pytest.raises(InvalidTask, match=f"name = '{wrong}': expected one of 'kink'"):
            case(f'kink{JOINED}{wrong}', 0)


@pytest.mark.parametrize(('name', 'seed', 'ends'), [('biased camera', 1, 'clean'),
                                                    ('turned camera', 1, 'refused')])
@pytest.mark.sweep
def test_a_loop_that_its_tracker_deceives_keeps_its_promise_or_says_why_it_stops(name, seed, ends):
    found = cell_trust.driven(name, seed)
    assert not found['error']
    assert not found['touched']
    assert found['covered'] is not False
    if ends == 'clean':
        assert found['clean']
    else:
        assert 'as looks tell, the camera is' in found['refused']
        assert found['depth'] == 0


def test_a_run_says_what_came_of_it():
    def driver(task):
        def command(images, time, gripper):
            if time > 0.1:
                raise Infeasible('it is too dark', 0, 'miss', 1.0)
            return task.start
        command.phase, command.promised = 'look', 1e-3
        return command

    found = cell_trust.driven('bump', 3, driver)
    assert found == json.loads(json.dumps(found, allow_nan=False))
    refused = 'Infeasible: it is too dark (miss, by 1 m)'
    assert (found['refused'], found['phase']) == (refused, 'look')
    assert (found['promised'], found['miss'], found['covered']) == (1e-3, None, None)
    assert found['time'] == pytest.approx(0.11)
    assert found['event_s'] == case('bump', 3)[0].bumps[0].time
    assert not found['happened']
    assert cell_trust.ended(found) == refused


def test_a_run_that_ends_in_an_error_is_told(monkeypatch, capsys):
    found = cell_trust.driven('nominal', 0, lambda task: 1 / 0)
    assert found['error'].startswith('Traceback')
    assert cell_trust.ended(found) == 'ZeroDivisionError: division by zero'
    row = dict(zip(cell_trust.HEADS, cell_trust.line('nominal', [found]), strict=True))
    assert (row['errors'], row['clean'], row['missed']) == ('1', '0', '0')
    monkeypatch.setattr(cell_trust, 'driven', lambda name, seed, *_: found)
    assert cell_trust.main(['--cases', 'nominal', '--seeds', '0:1', '--jobs', '1']) == 1


def test_the_table_counts():
    fine = {'threaded': True, 'depth': 0.7, 'miss': 1e-3, 'promised': 2e-3}
    found = [one(**fine), one(**fine), one(**{**fine, 'miss': 3.1e-3}),
             one(refused='Infeasible: no', phase='look'),
             one(refused='Infeasible: no', phase='enter', depth=0.1, miss=1e-3, promised=2e-3),
             one(force=0.5, depth=0.1, miss=4e-3, promised=4.5e-3),
             one(force=2.0, pushed=0.06), one(force=np.inf, pushed=np.inf),
             one(miss=np.nan, depth=0.2),
             one(**fine, stays=(Stay(2.0, 4.0, 9e-3, 2e-3), Stay(9.0, 12.0, 1e-3, 2e-3)))]
    row = dict(zip(cell_trust.HEADS, cell_trust.line('slip', found), strict=True))
    assert row == {'case': 'slip', 'runs': '10', 'happened': '10', 'clean': '4',
                   'refused before the sheet': '1', 'in it': '1', 'touched': '3',
                   'before the hole': '2', 'rammed': '2', 'missed': '1',
                   'errors': '0', 'covered': '5 of 6', 'largest miss [mm]': '4.00',
                   'promised there [mm]': '4.50', 'struck inside': '1', 'CPU [s]': '2.0'}
    assert cell_trust.ended(found[2]) == 'clean, by more than promised'
    assert [cell_trust.ended(found[k]) for k in (5, 6, 8)] == ['touched', 'rammed', 'missed']
    text = cell_trust.table(found)
    assert len(text.splitlines()) == 6
    assert '* slip: 1 refused in "enter", Infeasible' in text


def test_what_was_asked_for_is_run(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(cell_trust, 'driven', lambda name, seed, *_: {
        **one(name, force=2.0 * (seed == 6)), 'seed': seed})
    asked = ['--cases', 'slip', 'bump', '--jobs', '1', '--output', str(tmp_path / 'trust.jsonl')]
    assert cell_trust.main([*asked, '--seeds', '4:6']) == 0
    assert cell_trust.main([*asked, '--seeds', '4:7']) == 1
    runs = [json.loads(line) for line in (tmp_path / 'trust.jsonl').read_text().splitlines()]
    assert [(run['case'], run['seed']) for run in runs] == [
        (name, seed) for seed in (4, 5, 6) for name in ('slip', 'bump')]  # none of them twice
    assert '2 of 2' in capsys.readouterr().out


def test_cases_of_one_task_are_asked_for_beside_those_of_all(monkeypatch, tmp_path):
    monkeypatch.setattr(cell_trust, 'driven', lambda name, seed, driver, kind: {
        **one(name if kind == 'thread' else f'{kind}, {name}'), 'seed': seed})
    output = tmp_path / 'trust.jsonl'
    assert cell_trust.main(['--cases', 'kink', 'oblique, nominal', 'kink + late stamps', '--jobs',
                            '1', '--seeds', '4:6', '--output', str(output)]) == 0
    runs = [json.loads(line) for line in output.read_text().splitlines()]
    assert [(run['case'], run['seed']) for run in runs] == [
        (name, seed) for seed in (4, 5)
        for name in ('kink', 'oblique, nominal', 'kink + late stamps')]


def test_the_claims_count_pushes_before_the_hole_and_the_bound_of_each_case():
    fine = {'threaded': True, 'depth': 0.7, 'miss': 1e-3, 'promised': 2e-3}
    inside = one(force=0.5, **fine)
    untold = {name: value for name, value in inside.items() if name != 'pushes'}
    struck = one('bump', force=0.06, pushed=0.06, **fine, stays=(Stay(3.5, 9.0, 1e-3, 2e-3),))
    told = {words: (count, runs) for words, count, runs, *_ in cell_trust.claims(
        [one(**fine), inside, one('bump', force=0.06, pushed=0.06, **{**fine, 'miss': 3e-3}),
         untold, struck])}
    assert told['pushed by more than a touch before the hole, unless struck there'] == (2, 4)
    assert told['the bound covers the miss, slip'] == (3, 3)
    assert told['the bound covers the miss, bump'] == (0, 1)


def test_the_page_shows_the_runs_that_are_kept(tmp_path):
    runs, folder = tmp_path / 'trust.jsonl', tmp_path / 'site'
    runs.write_text(''.join(json.dumps(one(name)) + '\n' for name in ('slip', 'slip', 'bump')))
    folder.mkdir()
    assert cell_trust.main(['--judge', str(runs), '--page', str(folder)]) == 0
    assert (folder / 'cell_trust.jsonl').read_text() == runs.read_text()
    shown = (tmp_path / 'site.md').read_text()
    assert '| slip | 2 | 2 |' in shown and '| bump | 1 | 1 |' in shown
    assert '* rammed, all cases: 0 of 3' in shown


@pytest.mark.parametrize(('counted', 'word', 'bound'), [
    ((100, 100, 0.99, True), 'not shown', 0.05 ** (1 / 100)),  # the rule of three
    ((299, 299, 0.99, True), 'shown', 0.05 ** (1 / 299)),
    ((90, 100, 0.99, True), 'wrong', None), ((5, 100, 0.05, False), 'not shown', None),
    ((0, 59, 0.05, False), 'shown', 1 - 0.05 ** (1 / 59)),
    ((20, 100, 0.05, False), 'wrong', None), ((0, 30, 0.0, False), 'none seen', None),
    ((1, 30, 0.0, False), 'wrong', None), ((0, 0, 0.95, True), 'not shown', np.nan)])
def test_claims_are_judged_by_exact_bounds(counted, word, bound):
    assert cell_trust.verdict(*counted)[0] == word
    if bound is not None:
        assert cell_trust.verdict(*counted)[1] == pytest.approx(bound, nan_ok=True)


@pytest.mark.parametrize('kind', other_tasks.KINDS)
def test_other_tasks_are_always_the_same_and_have_room(kind):
    task = other_tasks.draw_other(kind, 3, cell_trust.DLO, cell_trust.RADIUS)
    assert task == other_tasks.draw_other(kind, 3, cell_trust.DLO, cell_trust.RADIUS)
    assert task != other_tasks.draw_other(kind, 4, cell_trust.DLO, cell_trust.RADIUS)
    count = {'two': 2, 'three': 3, 'insert': 1, 'hold': 0, 'oblique': 1}[kind]
    assert len(task.cutouts) == count
    assert task.room == (pytest.approx(4.25e-3) if kind != 'oblique' else pytest.approx(
        task.radius - task.rod.radius))
    assert len(task.obstacles) == len(task.bodies) == max(count, 1)
    if kind == 'insert':  # the bore begins at its mouth
        bore, = task.bodies
        mouth = bore.pose.position - 0.5 * bore.thickness * task.cutout.normal
        np.testing.assert_allclose(mouth, task.cutout.center, atol=1e-12)
    if kind == 'hold':
        up = task.cutout.pose.rotation[:, 2]
        assert task.off((task.cutout.center + 0.75e-3 * up)[None]) == pytest.approx(0, abs=1e-12)
        assert clearance([task.bar], 0.0, DirectSimulator(task.rod).solve(task.start)) > 0.02
