# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures by matplotlib: what is drawn lies where the answer says, equal and with units."""

import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from specimens import values

from dlo_planner import (
    Box,
    Capsule,
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
from dlo_planner.view.summary import flat

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
    assert {'gripper', 'far_end', 'held at the end'} <= set(texts)
    assert is_drawn(space, [end.position, end.position + 0.1 * end.direction])
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


def laid_down():
    """Return the Shape of a cable that lies on a table."""
    cable = Rod(1.0, 0.05, 1e-3, 1e-3, radius=2e-3)
    table = Plane((0, 0, 0), (0, 0, 1), 0.5, name='table')
    return DirectSimulator(cable, obstacles=[table], basis='local', n_elements=40).track(
        [Pose((0, 0, 0.15), (0, 0, 0, 1))])[-1]


def test_tension_is_a_color_and_its_scale_goes_from_the_least_to_the_largest():
    shape = laid_down()
    axes, bar = in_space(shape, color='tension')
    assert bar.get_ylabel() == 'tension [N]'
    low, top = min(0.0, shape.tension.min()), max(0.0, shape.tension.max())
    assert low < 0
    np.testing.assert_allclose(bar.get_ylim(), (low, top))
    painted = viridis((shape.tension - low) / (top - low))
    colors = next(colors for segments, colors in lines_of(axes)
                  if len(segments) == len(shape.s) - 1)
    np.testing.assert_allclose(colors[:, :3], 0.5 * (painted[1:] + painted[:-1]), atol=1e-9)
    moving = values()['DirectSimulator'].simulate([Pose((0, 0, 1), (0, 0, 0, 1)),
                                                   Pose((0, 0, 1.1), (0, 0, 0, 1))], 0.05)
    assert coloring(moving.shapes[-1], 'tension').caption == 'tension: not known'


def test_forces_inside_are_drawn_along_the_dlo_with_their_jumps():
    inside = laid_down().section_forces
    figure = inside.plot()
    tension, shear, moment = figure.axes
    assert [one.get_ylabel() for one in figure.axes] == ['tension [N]', 'shear [N]',
                                                         'moment [N m]']
    assert moment.get_xlabel() == 's, from the gripper [m]'
    for axes, curves in ((tension, [inside.tension]), (shear, inside.shear.T),
                         (moment, inside.moment.T)):
        for line, curve in zip(axes.lines[1:], curves, strict=True):  # the first is zero's
            np.testing.assert_array_equal(line.get_data(), (inside.s, curve))
    given = Figure()
    assert inside.plot(ax=given.add_subplot()) is given and len(given.axes) == 1


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
    assert axes.get_xlabel() == 'distance [mm]' and axes.get_xscale() == 'log'


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


def test_titles_and_texts_are_within_the_picture():
    hose = Rod.tube(1.0, 20e-3, 14e-3, 1200, 8e6, 0.45)
    hanging = DirectSimulator(hose).solve(Pose.looking_along((0, 0, 1), (0.2, 0, -1)))
    report = values()['ValidationReport']
    for figure, texts in ((hanging.plot(), lambda figure: [figure._suptitle]),
                          (report.plot(), lambda figure: figure.axes[0].texts)):
        figure.canvas.draw()
        within = (figure if texts(figure)[0] is figure._suptitle else figure.axes[0]).bbox
        for text in texts(figure):
            box = text.get_window_extent()
            assert within.x0 <= box.x0 and box.x1 <= within.x1


def test_a_report_has_no_bar_of_what_is_no_number():
    report = replace(values()['ValidationReport'], clearance=np.inf, swing=np.inf)
    axes, = report.plot().axes
    said = [text.get_text() for text in axes.texts]
    for text in ('nothing is near', 'could not be simulated', 'not looked at'):
        bar = axes.patches[said.index(text)]
        assert bar.get_width() == 0


def test_a_bore_is_drawn_as_deep_as_the_dlo_goes():
    hole = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.02)
    plan = InverseSimulator(values()['DirectSimulator']).insert(hole, depths=[0.0, 0.1, 0.2])
    figure = Figure()
    axes = figure.add_subplot()
    plan.plot(ax=axes)
    walls = np.concatenate([path.vertices for one in axes.collections for path in one.get_paths()])
    for corner in ((0.4, 1.02), (0.4, 0.98), (0.6, 1.02), (0.6, 0.98)):
        assert np.abs(walls - corner).sum(axis=1).min() < 1e-9
    space, _ = in_space(plan)
    bored = max((one for one in space.collections if isinstance(one, Poly3DCollection)),
                key=lambda one: np.max(one._vec[0]) if hasattr(one, '_vec') else np.max(
                    np.concatenate(one._faces)[:, 0]))
    corners = bored._vec[:3].T if hasattr(bored, '_vec') else np.concatenate(bored._faces)
    assert corners[:, 0].min() == pytest.approx(0.4) and corners[:, 0].max() == pytest.approx(0.6)
    assert np.hypot(*(corners[:, 1:] - (0, 1)).T).max() == pytest.approx(0.02)
    threaded = Figure().add_subplot()
    values()['Plan'].plot(ax=threaded)
    assert not [one for one in threaded.collections if len(one.get_paths()) == 2
                and one.get_linewidth()[0] == 3.0][1:]  # a hole has a plate alone


def test_one_waypoint_has_no_scale_of_time():
    bar = Capsule((0.5, -1, 0.8), (0.5, 1, 0.8), 0.02)
    simulator = DirectSimulator(Rod(1.0, 0.1, 0.3, 0.2, radius=0.005), obstacles=[bar])
    plan = InverseSimulator(simulator).hold_contact(Pose((0.5, 0, 0.82), (0, 0, 0, 1)), 0.6)
    figure = plan.plot()
    assert 'curvature [1/m]' in [axes.get_ylabel() for axes in figure.axes]
    legend, = figure.axes[0].get_legend().get_texts()
    assert legend.get_text().startswith('contact force, ')
    assert len(plan.plot(color='time').axes) == 1


def test_a_fit_shows_the_points_beside_the_dlo_found_and_numbers_with_units():
    fit = values()['Fit']
    seen, found = fit.observed[0], fit.found[0]
    np.testing.assert_array_equal(seen, values()['Observation'].points)
    shape = values()['DirectSimulator'].with_rod(fit.rod).solve(fit.grippers[0])
    np.testing.assert_allclose(found, shape.positions, atol=1e-12)
    picture, numbers = fit.plot().axes
    dots = next(one for one in picture.collections if len(one.get_offsets()) == len(seen))
    np.testing.assert_allclose(dots.get_offsets(), seen[:, [0, 2]])
    lines = np.concatenate([path.vertices for one in picture.collections
                            for path in one.get_paths()])
    assert all(np.abs(lines - point).sum(axis=1).min() < 1e-9 for point in found[:, [0, 2]])
    said = [text.get_text() for text in numbers.texts]
    value, spread = (flat(one)[0] for one in (fit.values, fit.deviations))
    assert said[0] == f'{value:.4g} ± {spread:.2g} N m^2'
    part, _ = numbers.lines[0].get_data()
    assert part[0] == pytest.approx(max(spread / value, 1e-4))


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.split('.')[0] == 'matplotlib']:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match=r"pip install 'dlo_planner\[figures\]'"):
        values()['Shape'].plot()
    assert '<img' not in values()['Shape']._repr_html_()
    assert 'Shape(1 m' in values()['Shape']._repr_html_()
