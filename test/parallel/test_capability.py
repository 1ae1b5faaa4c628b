# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The capability map: each of its entries is what the planner says, however it is computed."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from itertools import count
from multiprocessing import get_context

import numpy as np
import pytest
from matplotlib import pyplot as plt
from scipy.spatial.transform import Rotation

from dlo_planner import (
    DeadlineExceeded,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Workspace,
    progress,
    replay,
)
from dlo_planner.parallel import CapabilityMap, CellGrid, capability_map
from dlo_planner.parallel.capability import QUANTITIES, fingerprint
from dlo_planner.plan.plan import concatenate

DEPTHS = np.linspace(0, 0.8, 5)
GRID = CellGrid([(x, 0.0, z) for x in (0.4, 1.4) for z in (1.0, 1.3)],
                [(1, 0, 0), (1, 0, -1)], [5e-4, 0.05])
processes = partial(ProcessPoolExecutor, 2, mp_context=get_context('fork'))


@pytest.fixture(scope='module')
def inverse():
    wire = Rod.circular(1.0, 2e-3, 8960, 110e9, 0.34)
    return InverseSimulator(DirectSimulator(wire, n_elements=16),
                            workspace=Workspace((-2, -2, 0), (1, 2, 1.5)))


@pytest.fixture(scope='module')
def serial(inverse):
    return capability_map(inverse, GRID, depths=DEPTHS)


def test_each_entry_is_what_the_planner_says(inverse, serial):
    assert set(np.unique(serial.outcome)) > {'threaded', 'clearance'}
    for index in range(len(GRID)):
        at, cutout = np.unravel_index(index, GRID.shape), GRID.cutout(index)
        np.testing.assert_allclose(cutout.center, GRID.positions[at[0]])
        np.testing.assert_allclose(cutout.normal, GRID.directions[at[1]])
        assert cutout.radius == GRID.radii[at[2]]
        try:
            plan = inverse.thread(cutout, depths=DEPTHS)
        except Infeasible as refused:
            assert serial.outcome[at] == refused.constraint
            assert serial.amount[at] == refused.amount
            assert np.isnan(serial.clearance[at]) and not serial.threaded[at]
            continue
        assert serial.threaded[at] and serial.fraction[at] == 1 and serial.amount[at] == 0
        assert serial.clearance[at] == plan.clearance.min()
        assert serial.stability[at] == plan.stability.min()
        np.testing.assert_array_equal(serial.gripper[at][:3], plan.grippers[0].position)


def test_the_roll_makes_the_gripper(serial):
    for at in np.argwhere(serial.threaded):
        first, roll = serial.gripper[tuple(at)], serial.roll[tuple(at)]
        pose = Pose(first[:3], first[3:])
        upright = Pose.looking_along(first[:3], pose.direction)
        turned = upright.rotation @ Rotation.from_euler('x', roll).as_matrix()
        np.testing.assert_allclose(turned, pose.rotation, atol=1e-9)


def test_least_radius(serial):
    np.testing.assert_array_equal(np.isinf(serial.least_radius), ~serial.threaded.any(axis=2))
    assert (serial.least_radius[serial.threaded.any(axis=2)] == 0.05).all()


def test_every_executor_makes_the_same_map(inverse, serial):
    assert capability_map(inverse, GRID, processes, depths=DEPTHS, chunk=3) == serial
    with ThreadPoolExecutor(2) as executor:
        assert capability_map(inverse, GRID, executor, depths=DEPTHS, chunk=5) == serial


def test_starts(inverse):
    grid = CellGrid([(0.4, 0.0, 1.0)], [(1, 0, 0)], [0.05])
    beyond, before = (Pose((x, 0, 1.0), (0, 0, 0, 1)) for x in (0.9, -1.2))
    for starts, best in (((before,), 0), ((beyond, before), 1)):
        found = capability_map(inverse, grid, starts=starts, depths=DEPTHS)
        assert found.threaded.all() and found.start.item() == best
    refused = capability_map(inverse, grid, starts=[beyond], depths=DEPTHS)
    assert refused.outcome.item().startswith('start_phase.')
    assert not np.isnan(refused.amount).any()


def test_a_way_that_one_standoff_alone_allows_is_found(inverse):
    # slanting down: the farther before the hole the free end waits, the higher the gripper
    grid = CellGrid([(0.75, 0.0, 0.95)], [(1, 0, -1)], [0.05])
    start = Pose((-0.6, 0, 1.0), (0, 0, 0, 1))
    plan = InverseSimulator(inverse.simulator).thread(grid.cutout(0), start=start, depths=DEPTHS)
    ceiling = plan.grippers[0].position[2] + 0.05
    cell = InverseSimulator(inverse.simulator, workspace=Workspace((-2, -2, 0), (2, 2, ceiling)))
    assert capability_map(cell, grid, starts=[start], depths=DEPTHS).threaded.all()
    with pytest.raises(Infeasible, match=r'workspace\.upper\.z'):
        cell.approach(grid.cutout(0), plan, start, standoff=0.1)
    way = concatenate(cell.approach(grid.cutout(0), plan, start, standoff=0.05), plan)
    assert replay(cell.simulator, way, workspace=cell.workspace).workspace_margin > 0


class _InterruptedError(Exception):
    pass


def test_it_goes_on_after_an_interruption(inverse, serial, tmp_path):
    def stop(done, _):
        if done >= 9:
            raise _InterruptedError

    with pytest.raises(_InterruptedError):
        capability_map(inverse, GRID, depths=DEPTHS, folder=tmp_path / 'map', chunk=3,
                       progress=stop)
    part = CapabilityMap.load(tmp_path / 'map')
    done = (part.outcome != '').ravel()
    assert done.sum() == 9 and done[:9].all()
    np.testing.assert_array_equal(part.outcome.ravel()[:9], serial.outcome.ravel()[:9])
    assert 'not looked at' in repr(part)
    (tmp_path / 'map' / 'part-0000001.npz').write_bytes(b'half of a fi')  # a crash of the disk
    reported = []
    again = capability_map(inverse, GRID, processes, depths=DEPTHS, folder=tmp_path / 'map',
                           chunk=3, progress=lambda *both: reported.append(both))
    assert again == serial == CapabilityMap.load(tmp_path / 'map')
    assert reported[0][0] > 6 and reported[-1] == (16, 16)  # six were there
    assert not list((tmp_path / 'map').glob('.*'))
    reported.clear()
    assert capability_map(inverse, GRID, depths=DEPTHS, folder=tmp_path / 'map', chunk=3,
                          progress=lambda *both: reported.append(both)) == serial
    assert reported == []


def test_its_own_deadline_makes_nothing_undecided(inverse, tmp_path, monkeypatch):
    for seconds in range(40, 80, 5):
        monkeypatch.setattr(progress, 'monotonic', count(0.0).__next__)  # 1 s later at each look
        folder = tmp_path / f'{seconds}'
        with pytest.raises(DeadlineExceeded):
            capability_map(inverse, GRID, depths=DEPTHS, folder=folder, chunk=1,
                           patience=float(seconds), deadline=float(seconds))
        assert (CapabilityMap.load(folder).outcome != 'undecided').all()


def test_a_folder_belongs_to_one_map(inverse, tmp_path):
    grid = CellGrid([(0.4, 0.0, 1.0)], [(1, 0, 0)], [0.05])
    capability_map(inverse, grid, depths=DEPTHS, folder=tmp_path)
    for changed in ({'depths': DEPTHS[:3]}, {'chunk': 2}, {'starts': [Pose.identity()]}):
        with pytest.raises(InvalidTask, match='folder'):
            capability_map(inverse, grid, **{'depths': DEPTHS, 'folder': tmp_path} | changed)
    other = InverseSimulator(inverse.simulator)  # without its workspace
    with pytest.raises(InvalidTask, match='folder'):
        capability_map(other, grid, depths=DEPTHS, folder=tmp_path)
    with pytest.raises(InvalidTask, match='folder'):
        CapabilityMap.load(tmp_path / 'elsewhere')


def test_fingerprints_go_by_content(inverse):
    again = InverseSimulator(DirectSimulator(
        Rod.circular(1.0, 2e-3, 8960, 110e9, 0.34), n_elements=16),
        workspace=Workspace((-2, -2, -0.0), (1, 2, 1.5)))
    assert fingerprint(again, 1.0) == fingerprint(inverse, 1.0)
    assert fingerprint(again, 1.0) != fingerprint(inverse, 1.0 + 1e-15)
    assert len({fingerprint(value) for value in (1, 1.0, '1', (1,), (1, ()), None)}) == 6


def test_what_takes_too_long_is_undecided(inverse, tmp_path):
    found = capability_map(inverse, GRID, depths=DEPTHS, patience=1e-9)
    assert (found.outcome == 'undecided').all() and not found.threaded.any()
    figure = found.plot(axis='z', quantity='clearance')  # crosses alone
    figure.savefig(tmp_path / 'crosses.png')
    assert not sum(len(axis.collections[0].get_offsets()) for axis in figure.axes[:2])


@pytest.mark.parametrize('quantity', QUANTITIES)
def test_slices(serial, quantity):
    figure = serial.plot(axis='x', quantity=quantity)
    shown = [axis for axis in figure.axes if axis.get_title()]
    assert [axis.get_title() for axis in shown] == ['x = 0.4 m', 'x = 1.4 m']
    for axis in shown:
        assert axis.get_aspect() == 1 and '[m]' in axis.get_xlabel()
    # at x = 0.4 m both places have cut-outs that can be threaded, at 1.4 m the gripper is too far
    counts = [len(axis.collections[0].get_offsets()) for axis in shown]
    threaded = serial.threaded.any(axis=(1, 2))
    assert counts == [threaded[:2].sum(), threaded[2:].sum()]
    plt.close('all')
