# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What was found out has a table, a picture and a file: fits, estimates, maps, motions, shapes."""

import json

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from specimens import capability, values

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod, Sphere

matplotlib.use('Agg')
NAMES = ['Fit', 'Estimate', 'Robustness', 'Trajectory', 'CapabilityMap', 'Shapes']


def answer(name):
    return capability() if name == 'CapabilityMap' else values()[name]


@pytest.fixture(autouse=True)
def _closed():
    yield
    pyplot.close('all')


def rows(name):
    """Return quantity -> rest of the line of a summary."""
    return {line[2:].split('  ', 1)[0].strip(): line[2:].split('  ', 1)[1].strip()
            for line in answer(name).summary().splitlines()[1:]}


@pytest.mark.parametrize(('name', 'ending'), [
    ('Trajectory', 'npz'), *((name, 'json') for name in NAMES if name != 'Estimate')])
def test_what_is_kept_comes_back_as_it_was(name, ending, tmp_path):
    value = answer(name)
    value.save(tmp_path / f'kept.{ending}')
    assert type(value).load(tmp_path / f'kept.{ending}') == value
    other = values()['Shape'] if name != 'Shape' else values()['Plan']
    other.save(tmp_path / f'other.{ending}')
    with pytest.raises(InvalidTask, match=rf'other\.{ending}'):
        type(value).load(tmp_path / f'other.{ending}')
    with pytest.raises(InvalidTask, match='path'):
        type(value).load(tmp_path / 'none.json')


def test_an_estimate_is_kept_for_records(tmp_path):
    estimate = answer('Estimate')
    estimate.save(tmp_path / 'kept.json')
    kept = json.loads((tmp_path / 'kept.json').read_text())
    assert {name: kept['values'][name] for name in estimate.names} == estimate.values
    assert kept['covariance'] == estimate.covariance.tolist()


def test_tables_say_what_the_answers_say():
    fit, estimate, robust, trajectory, mapped, shapes = map(answer, NAMES)
    deviation = np.ravel(fit.deviations['bending_stiffness'])[0]
    assert rows('Fit')[fit.names[0]].endswith(f'+- {deviation:.2g} N m^2')
    assert rows('Estimate')['looks'] == str(estimate.looks)
    assert float(rows('Robustness')['miss by length'].split()[0]) == pytest.approx(
        robust.by_cause[:, robust.causes.index('length')].max(), rel=1e-3)
    fastest = max(np.linalg.norm(trajectory.at(np.linspace(0, trajectory.duration, 4001))[1][:, :3],
                                 axis=1))
    most, limit = rows('Trajectory')['linear speed, largest and limit'].split(' m/s')[0].split(
        ' of ')
    assert float(most) == pytest.approx(fastest, rel=1e-3)
    assert float(limit) == trajectory.limits.linear_speed
    assert rows('CapabilityMap')['threaded'].split()[0] == str(mapped.threaded.sum())
    assert rows('Shapes')['shapes'] == str(len(shapes))


@pytest.mark.every(3)
@pytest.mark.parametrize('name', NAMES)
def test_each_has_a_picture(name, tmp_path):
    value = answer(name)
    figure = value.plot()
    figure.savefig(tmp_path / 'picture.png', dpi=40)
    assert all(axes.get_xlabel() or axes.get_ylabel() for axes in figure.axes)
    if name != 'CapabilityMap':
        axes = Figure().add_subplot()
        assert value.plot(ax=axes) is axes.figure
        with pytest.raises(InvalidTask, match='ax = 3'):
            value.plot(ax=3)
    assert repr(value).split('(')[0] in value._repr_html_()


def test_bars_are_as_long_as_deviations_and_shapes_lie_where_they_are():
    estimate = answer('Estimate')
    axes, = estimate.plot().axes
    lengths = [bar.get_width() for bar in axes.patches]
    np.testing.assert_allclose(lengths, 100 * np.array(list(estimate.deviations.values()))
                               / estimate.uncertain.deviations)
    axes = Figure().add_subplot()
    shapes = answer('Shapes')
    shapes.plot(ax=axes)
    drawn = np.concatenate([path.vertices for one in axes.collections for path in one.get_paths()])
    for point in shapes.positions[:, :, [0, 2]].reshape(-1, 2):
        assert np.abs(drawn - point).sum(axis=1).min() < 1e-9


def test_a_shape_tells_the_largest_forces_inside_and_where():
    shape = values()['Shape']
    said = {line.split('  ')[1]: line.split() for line in shape.summary().splitlines()[1:]}
    inside = shape.section_forces
    assert float(said['tension, largest'][2]) == pytest.approx(inside.tension.max(), rel=1e-3)
    bend = np.linalg.norm(inside.bending_moment, axis=1)
    assert said['bending moment, largest'][3:] == [f'{bend.max():.4g}', 'N', 'm,', 'at', '0', 'm']
    pushed = values()['DirectSimulator'].simulate(
        [Pose((0, 0, 1), (0, 0, 0, 1)), Pose((0, 0, 1.1), (0, 0, 0, 1))], 0.05).shapes[-1]
    line, = (line for line in pushed.summary().splitlines() if 'shear' in line)
    assert line.split()[3:6] == ['not', 'looked', 'at']


def test_a_shape_tells_how_it_lies_on_what():
    cable = Rod(1.0, 0.05, 1e-3, 1e-3, radius=2e-3)
    table = Plane((0, 0, 0), (0, 0, 1), 0.5, name='table')
    shape = DirectSimulator(cable, obstacles=[table], basis='local', n_elements=40).track(
        [Pose((0.02 * k, 0, 0.15), (0, 0, 0, 1)) for k in range(4)])[-1]
    touch, = shape.touches
    assert touch.length > 0.4
    assert f'lies on table over {touch.length:.3g} m' in shape.summary()
    assert f'{touch.slipping} of {touch.contacts} contacts slip' in shape.summary()


def test_a_shape_tells_what_it_presses_by_name():
    rod, hand = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01), Pose((0, 0, 1), (0, 0, 0, 1))
    floor = Plane((0, 0, 0.9), (0, 0, 1), name='work bench')
    simulator = DirectSimulator(rod, n_elements=16, n_terms=8, obstacles=[Sphere((9, 9, 9), 1.0),
                                                                          floor])
    shape = simulator.solve(hand)
    force = sum(one.force for one in shape.contacts)
    line, = (line for line in shape.summary().splitlines() if 'presses' in line)
    assert line.split()[:4] == ['presses', 'work', 'bench', 'with']
    assert float(line.split()[4]) == pytest.approx(force, rel=1e-3) and force > 0
    unnamed = simulator.with_obstacles([Plane((0, 0, 0.9), (0, 0, 1))]).solve(hand)
    assert unnamed.contacts and 'presses' not in unnamed.summary()
