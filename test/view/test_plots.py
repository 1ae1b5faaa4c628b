# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures by matplotlib: what is drawn lies where the answer says, equal and with units."""

import sys

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from specimens import values

from dlo_planner import (
    Box,
    CutOut,
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Limits,
    Plane,
    Pose,
    Rod,
    replay,
)
from dlo_planner.errors import MissingExtra
from dlo_planner.tasks import Carry
from dlo_planner.view.colors import ALERT, coloring, viridis
from dlo_planner.view.mpl import azimuth
from dlo_planner.view.scene import plan_primitives

matplotlib.use('Agg')


@pytest.fixture(autouse=True)
def _closed():
    yield
    pyplot.close('all')


def in_space(value, **options):
    """Return the Axes in space that a value is drawn in, and those of the color bar."""
    figure = Figure()
    value.plot(ax=figure.add_subplot(projection='3d'), **options)
    space, = (one for one in figure.axes if one.name == '3d')
    bar = next(one for one in figure.axes if one.get_ylabel() and one is not space)
    return space, bar


def lines_of(axes):
    """Return (segments, colors) of all lines in space."""
    return [(np.array(one._segments3d, dtype=object), one.get_colors())
            for one in axes.collections if isinstance(one, Line3DCollection)]


def points_of(axes):
    """Return (n, 3) all points of lines in space."""
    return np.array([point for segments, _ in lines_of(axes) for line in segments
                     for point in line], dtype=float)


def test_the_ways_of_all_arms_are_drawn_and_named():
    direct = DirectSimulator(Rod(1.0, 0.05, 0.1, 0.08), n_elements=16, basis='local')
    begin, end = (Pose(place, (0, 0, 0, 1)) for place in ((0.7, 0, 0), (0.75, 0.1, 0.1)))
    plan = InverseSimulator(direct).plan(Carry(
        Pose((0.0, 0.1, 0.0), (0, 0, 0, 1)), end, far_end=FarEnd(begin)), start=Pose.identity())
    space, _ = in_space(plan)
    assert is_drawn(space, [pose.position for pose in plan.far_end_poses])
    texts = [text.get_text() for legend in space.figure.legends for text in legend.get_texts()]
    texts += [text.get_text() for text in space.get_legend().get_texts()] if (
        space.get_legend()) else []
    assert {'gripper', 'far_end'} <= set(texts)
    ids = [(one.group, one.index) for one in plan_primitives(plan, ())
           if one.group == 'trajectory']
    assert ids == [('trajectory', k) for k in range(4)]


def is_drawn(axes, points):
    """Whether lines in space go through all of the points."""
    drawn = points_of(axes)
    return all(np.abs(drawn - point).sum(axis=1).min() < 1e-9 for point in points)


def test_a_shape_is_drawn_where_it_is_in_the_colors_of_its_bend():
    shape = values()['Shape']
    axes, bar = in_space(shape)
    painted = coloring(shape)
    segments, colors = next(one for one in lines_of(axes) if len(one[0]) == len(shape.s) - 1)
    np.testing.assert_allclose(np.array(segments[:, 0].tolist(), dtype=float),
                               shape.positions[:-1])
    np.testing.assert_allclose(colors[:, :3], 0.5 * (painted.colors[1:] + painted.colors[:-1]))
    assert bar.get_ylabel() == 'curvature [1/m]'
    sharpest = np.linalg.norm(shape.strains[:, 1:], axis=1).max()
    np.testing.assert_allclose(bar.get_ylim(), (0.0, sharpest))


def test_axes_are_equal_and_have_units():
    axes, _ = in_space(values()['Shape'])
    extents = np.array([np.ptp(limits) for limits in (
        axes.get_xlim(), axes.get_ylim(), axes.get_zlim())])
    shown = axes._box_aspect  # matplotlib has no public name for it
    np.testing.assert_allclose(shown / shown[0], extents / extents[0], rtol=1e-9)
    assert [axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()] == [
        'x [m]', 'y [m]', 'z [m]']


def test_all_of_it_is_within_the_axes():
    axes, _ = in_space(values()['Plan'])
    points = points_of(axes)
    for values_, limits in zip(points.T, (axes.get_xlim(), axes.get_ylim(), axes.get_zlim()),
                               strict=True):
        assert limits[0] <= values_.min() and values_.max() <= limits[1]


@pytest.mark.parametrize('turn', [0.0, 0.4, 1.3, 2.0])
def test_it_is_seen_from_beside_the_plane_it_lies_in(turn):
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    points = np.outer(np.linspace(0, 1, 9), along) + (0, 0, 1)
    view = np.deg2rad(azimuth(points))
    across = abs(np.array([np.cos(view), np.sin(view)]) @ along[:2])
    assert across == pytest.approx(np.sin(np.deg2rad(35)))


def test_gripper_hole_and_way_of_a_plan_are_drawn():
    plan, hole = values()['Plan'], values()['CutOut']
    axes, bar = in_space(plan)
    for gripper in plan.grippers:
        length = 0.09 * plan.shapes[0].s[-1]
        assert is_drawn(axes, [gripper.position + length * gripper.rotation[:, k]
                               for k in range(3)])
    angle = np.linspace(0, 2 * np.pi, 9)
    rim = hole.center + hole.radius * (np.outer(np.cos(angle), hole.pose.rotation[:, 1])
                                       + np.outer(np.sin(angle), hole.pose.rotation[:, 2]))
    assert is_drawn(axes, rim[[0, 2, 4, 6]])
    assert any(isinstance(one, Poly3DCollection) for one in axes.collections)
    assert bar.get_ylabel() == 'time [s]'
    np.testing.assert_allclose(bar.get_ylim(), (0.0, plan.times[-1]))
    colors = [tuple(colors[0][:3]) for segments, colors in lines_of(axes)
              if len(segments) == 1 and len(segments[0]) == len(plan.shapes[0].s)]
    np.testing.assert_allclose(colors, viridis([0.0, 1.0]))


def test_centers_without_a_direction_are_drawn_too():
    simulator = DirectSimulator(values()['Rod'], n_elements=8, n_terms=4)
    holes = [CutOut(Pose.looking_along((x, 0, 1), (1, 0, 0))) for x in (0.0, 0.3)]
    plan = InverseSimulator(simulator).thread_two(*holes, depths=[0.4, 0.5])
    axes, _ = in_space(plan)
    balls = [np.mean([vertex for face in one._faces for vertex in face], axis=0)
             if hasattr(one, '_faces') else one._vec[:3].mean(axis=1)
             for one in axes.collections if isinstance(one, Poly3DCollection)]
    for hole in holes:
        assert min(np.linalg.norm(ball - hole.center) for ball in balls) < 1e-3


def test_obstacles_are_drawn_those_of_the_shape_and_further_ones():
    rod = values()['Rod']
    floor = Plane((0, 0, 0.9), (0, 0, 1))
    box = Box(Pose((0.5, 1.5, 0.5), (0, 0, 0, 1)), (0.2, 0.2, 0.2))
    shape = DirectSimulator(rod, n_elements=8, n_terms=4, obstacles=[floor]).track(
        [Pose((0, 0, 1), (0, 0, 0, 1))])[0]
    assert shape.obstacles == (floor,)
    bare, _ = in_space(values()['Shape'])
    own, _ = in_space(shape)
    both, _ = in_space(shape, obstacles=[box, floor])
    count = [sum(isinstance(one, Poly3DCollection) for one in axes.collections)
             for axes in (bare, own, both)]
    assert count == [0, 1, 2]
    assert both.get_ylim()[1] >= 1.6  # the box is in the picture


def test_a_motion_shows_the_way_of_its_free_end():
    motion = values()['Motion']
    axes, bar = in_space(motion)
    assert is_drawn(axes, [shape.positions[-1] for shape in motion.shapes])
    assert bar.get_ylabel() == 'time [s]'
    assert in_space(motion, color='curvature')[1].get_ylabel() == 'curvature [1/m]'


@pytest.mark.parametrize(('direction', 'seen'), [
    ((1, 0, 0.2), ['x [m]', 'z [m]']), ((0, 1, 0.2), ['y [m]', 'z [m]']),
    ((1, 1, 0.2), ['x [m]', 'y [m]', 'z [m]'])])
def test_what_is_flat_is_drawn_from_the_side_and_the_figure_is_full(direction, seen):
    shape = values()['DirectSimulator'].solve(Pose.looking_along((0, 0, 1), direction))
    figure = shape.plot()
    axes = figure.axes[0]
    assert [label.get_text() for label in (axes.xaxis.label, axes.yaxis.label, *(
        [axes.zaxis.label] if axes.name == '3d' else []))] == seen
    figure.canvas.draw()
    drawn = [box for one in figure.axes for axis in one._axis_map.values()
             if (box := axis.get_tightbbox(figure.canvas.get_renderer())) is not None]
    width, height = figure.get_size_inches() * figure.dpi
    covered = [max(getattr(one, high) for one in drawn) - min(getattr(one, low) for one in drawn)
               for low, high in (('x0', 'x1'), ('y0', 'y1'))]
    least = 0.55 if axes.name == '3d' else 0.75  # above it is the title
    assert covered[0] > 0.85 * width and covered[1] > least * height
    assert min(one.x0 for one in drawn) >= 0 and max(one.x1 for one in drawn) <= width


def test_axes_that_are_given_are_drawn_in_from_the_side():
    plan = values()['Plan']
    figure = Figure()
    axes = figure.add_subplot()
    assert plan.plot(ax=axes) is figure
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ('x [m]', 'z [m]')
    drawn = np.concatenate([path.vertices for one in axes.collections for path in one.get_paths()])
    for shape in plan.shapes:
        for point in shape.positions[:, [0, 2]]:
            assert np.abs(drawn - point).sum(axis=1).min() < 1e-9
    hole = values()['CutOut']  # its normal is along x: the plate is cut above and below
    plate = next(one for one in axes.collections if one.get_linewidth()[0] == 3.0)
    ends = np.concatenate([path.vertices for path in plate.get_paths()])
    np.testing.assert_allclose(np.abs(ends[:, 1] - hole.center[2]).min(), hole.radius)


def test_a_limited_rod_has_its_limit_on_the_bar():
    limited = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, max_bend_curvature=0.2)
    shape = DirectSimulator(limited, n_elements=8, n_terms=4).solve(values()['Pose'])
    axes, bar = in_space(shape)
    assert bar.get_ylim()[1] == pytest.approx(0.2)
    assert any(np.isclose(colors[:, :3], ALERT).all(axis=1).any() for _, colors in lines_of(axes))


def test_a_report_says_what_it_found_and_whether_it_is_safe():
    report = values()['ValidationReport']
    axes, = report.plot().axes
    assert 'not safe: it was not looked at in motion' in axes.get_title()
    said = [text.get_text() for text in axes.texts]
    assert said.count('not looked at') == sum(np.isnan(getattr(report, name)) for name in (
        'position_error', 'deviation', 'max_tracking_error', 'swing', 'arrival', 'departure',
        'clearance',
        'dynamic_clearance', 'workspace_margin'))
    assert f'{1e3 * report.clearance:.3g} mm' in said
    assert axes.get_xlabel() == 'mm' and axes.get_xscale() == 'log'


def test_a_report_with_a_trajectory_shows_how_fast_the_gripper_is():
    report = replay(values()['DirectSimulator'], values()['Plan'], limits=Limits(), tolerance=0.05)
    bars, speeds, turning = report.plot().axes
    assert bars.get_title() == 'safe to execute'
    assert any(line.get_xdata()[0] == 50.0 for line in bars.lines)  # the tolerance, mm
    times, shown = speeds.lines[0].get_data()
    np.testing.assert_allclose(
        shown, 1e3 * np.linalg.norm(report.trajectory.at(times)[1][:, :3], axis=1))
    assert speeds.get_ylabel() == 'speed [mm/s]' and turning.get_ylabel() == 'turning [deg/s]'
    figure = Figure()
    assert report.plot(ax=figure.add_subplot()) is figure


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.split('.')[0] == 'matplotlib']:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match=r"pip install 'dlo_planner\[figures\]'"):
        values()['Shape'].plot()
    assert '<img' not in values()['Shape']._repr_html_()
    assert 'Shape(1 m' in values()['Shape']._repr_html_()
