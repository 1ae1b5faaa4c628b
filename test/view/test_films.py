# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Films: as many pictures as asked for, of the right instants; a way out without ffmpeg."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from PIL import Image
from specimens import values

from dlo_planner import DirectSimulator, InvalidTask, Plan, Pose
from dlo_planner.errors import MissingExtra
from dlo_planner.view import plots
from dlo_planner.view.colors import coloring
from dlo_planner.view.plots import between

matplotlib.use('Agg')


def pictures(path):
    """Return the pictures (n, height, width, 3) of a GIF, and how long it lasts, s."""
    found, seconds = [], 0.0
    with Image.open(path) as film:
        for number in range(film.n_frames):
            film.seek(number)
            found.append(np.asarray(film.convert('RGB'), dtype=int))
            seconds += film.info['duration'] / 1000
    return np.array(found), seconds


def lifted():
    """Return a Motion in which no two pictures are alike."""
    return values()['DirectSimulator'].simulate(
        [Pose((0, 0, 1 + 0.1 * k), (0, 0, 0, 1)) for k in range(4)], 0.05)


@pytest.mark.every(2)
@pytest.mark.parametrize('make', [lambda: values()['Plan'], lifted], ids=['plan', 'motion'])
def test_a_gif_lasts_as_long_as_asked_for_and_moves(tmp_path, make):
    path = make().animate(tmp_path / 'film.gif', seconds=0.4)
    assert path == tmp_path / 'film.gif'
    found, seconds = pictures(path)
    assert len(found) == 8  # 20 a second
    assert seconds == pytest.approx(0.4, abs=1e-9)
    assert np.abs(found[-1] - found[0]).max() > 50


def test_by_itself_it_lasts_as_long_as_the_motion(tmp_path, monkeypatch):
    monkeypatch.setitem(plots._RATE, '.gif', 1)  # pictures a second: as many take no time
    plan = replace(values()['Plan'], times=[0.0, 14.0])
    _, seconds = pictures(plan.animate(tmp_path / 'film.gif'))
    assert seconds == pytest.approx(14.0, abs=1e-9)


def test_between_two_shapes_it_is_in_the_middle():
    plan = values()['Plan']
    painted = [coloring(shape) for shape in plan.shapes]
    points, colors, gripper = between(plan, painted, 0.5 * (plan.times[0] + plan.times[1]))
    np.testing.assert_allclose(points, 0.5 * (plan.shapes[0].positions + plan.shapes[1].positions))
    np.testing.assert_allclose(colors, 0.5 * (painted[0].colors + painted[1].colors))
    np.testing.assert_allclose(gripper.position, 0.5 * (plan.grippers[0].position
                                                        + plan.grippers[1].position))
    for k in (0, 1):
        points, _, gripper = between(plan, painted, plan.times[k])
        np.testing.assert_allclose(points, plan.shapes[k].positions)
        np.testing.assert_allclose(gripper.matrix, plan.grippers[k].matrix, atol=1e-12)


def test_turning_grippers_turn_evenly():
    simulator = values()['DirectSimulator']
    quarter = Pose((0, 0, 1), (0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)))
    motion = simulator.simulate([Pose((0, 0, 1), (0, 0, 0, 1)), quarter], 1.0)
    gripper = between(motion, [coloring(shape) for shape in motion.shapes], 0.5)[2]
    np.testing.assert_allclose(gripper.direction, [np.sqrt(0.5), np.sqrt(0.5), 0], atol=1e-9)


def test_shapes_with_other_nodes_follow_each_other():
    plan = values()['Plan']
    coarse = DirectSimulator(values()['Rod'], n_elements=4, n_terms=3).solve(plan.grippers[1])
    mixed = replace(plan, shapes=(plan.shapes[0], coarse))
    painted = [coloring(shape) for shape in mixed.shapes]
    points, colors, _ = between(mixed, painted, 0.99 * plan.times[1])
    np.testing.assert_array_equal(points, plan.shapes[0].positions)
    assert len(colors) == len(points)
    # and the last one is shown at the end
    np.testing.assert_array_equal(between(mixed, painted, plan.times[1])[0], coarse.positions)


def test_without_ffmpeg_a_gif_is_offered(tmp_path, monkeypatch):
    from matplotlib.animation import FFMpegWriter  # noqa: PLC0415
    monkeypatch.setattr(FFMpegWriter, 'isAvailable', classmethod(lambda cls: False))
    with pytest.raises(MissingExtra, match=r'ffmpeg.*film\.gif'):
        values()['Plan'].animate(tmp_path / 'film.mp4')
    assert not (tmp_path / 'film.mp4').exists()


@pytest.mark.parametrize(('path', 'options', 'named'), [
    ('film.avi', {}, 'path'), ('film', {}, 'path'), ('nowhere/film.gif', {'seconds': 0.2}, 'path'),
    ('film.gif', {'seconds': 0}, 'seconds'), ('film.gif', {'seconds': 121}, 'seconds'),
    ('film.gif', {'color': 'time'}, 'color')])
def test_what_makes_no_sense_is_named(tmp_path, path, options, named):
    with pytest.raises(InvalidTask, match=named):
        values()['Plan'].animate(tmp_path / path, **options)


def test_of_nothing_there_is_no_film(tmp_path):
    plan = values()['Plan']
    empty = Plan(*([] if isinstance(one, tuple) else one for one in (
        np.zeros(0), (), (), np.zeros(0), np.zeros(0), np.zeros(0), (), np.zeros((0, 1, 3)), ())),
        fraction=1.0, status=plan.status)
    with pytest.raises(InvalidTask, match='with a shape'):
        empty.animate(tmp_path / 'film.gif')
