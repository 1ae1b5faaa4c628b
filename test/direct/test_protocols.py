# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Protocols of the field: what slender rods are known for; default settings if none are named.

Romero et al. (2021), Physical validation of simulators in computer graphics; references by SciPy
(`references.buckling`) and closed forms. docs/protocols.md lists them all.
"""

import numpy as np
import pytest
from references.buckling import (
    Planar,
    arch_that_snaps,
    critical,
    level_cantilever,
    moment_that_buckles,
)
from references.friction import capstan
from scipy.spatial.transform import Rotation

from dlo_planner import Capsule, DirectSimulator, FarEnd, PointLoad, Pose, Rod

HERE = Pose.identity()
EDGE = Pose((0, 0, 0), Rotation.from_euler('x', 90, degrees=True).as_quat())
UP = Pose.looking_along((0, 0, 0), (0, 0, 1))
G = 9.81


def box(load, **options):
    """Return width and height of a level cantilever, and its Shape."""
    shape = DirectSimulator(Rod(1.0, load / G, 1.0, 0.75), **options).solve(HERE)
    return *np.ptp(shape.positions, axis=0)[[0, 2]], shape


def indifferent(make, gripper, factors, **options):
    """Return the factor at which the stability of the planar shapes of rods vanishes."""
    shapes = [DirectSimulator(make(factor), **options).solve(gripper) for factor in factors]
    for shape in shapes:
        assert shape.converged and np.abs(shape.positions[:, 1]).max() < 1e-6
    found = np.roots(np.polyfit(factors, [shape.stability for shape in shapes], 2))
    return found[np.argmin(np.abs(found - 1))].real


@pytest.mark.parametrize('load', [*10.0**np.arange(-2, 3.01, 0.5), 130.0, 200.0, 450.0])
def test_cantilever_over_five_decades(load):
    width, height = level_cantilever(load)
    found = box(load)
    assert found[2].converged
    assert found[:2] == pytest.approx((width, height), abs=3e-4)
    assert found[1] / found[0] == pytest.approx(height / width, rel=1e-3)
    fine = box(load, accuracy=1e-5)
    assert fine[1] / fine[0] == pytest.approx(height / width, rel=1e-3)


def test_cantilever_reference_is_that_of_the_table():
    # drops of the heavy elastica, as in test_closed_forms
    for load, drop in ((1, 0.123471), (5, 0.495905), (20, 0.829881), (100, 0.937524)):
        assert level_cantilever(load)[1] == pytest.approx(drop, abs=1e-6)


@pytest.mark.every(6)
@pytest.mark.parametrize(('kind', 'closed'), [('tip', 4.0126), ('load', 12.854)])
@pytest.mark.parametrize(('strong', 'torsion'), [(1e4, 1.0), (100.0, 2.0), (10.0, 0.7)])
def test_lateral_buckling_of_a_strip(kind, closed, strong, torsion):
    reference = critical(lambda load: Planar(**{kind: load}, strong=strong), torsion,
                         np.linspace(2, 30, 15))
    if strong == 1e4:  # Michell's and Prandtl's, for a strip that does not bend before
        assert reference == pytest.approx(closed * np.sqrt(torsion), rel=3e-4)

    def strip(factor):
        mass = factor * reference / G
        return Rod(1.0, mass if kind == 'load' else 0.0, (1.0, strong), torsion,
                   tip_mass=mass if kind == 'tip' else 0.0)

    assert indifferent(strip, EDGE, (0.95, 0.97, 0.99)) == pytest.approx(1.0, abs=1e-3)
    beyond = DirectSimulator(strip(1.03)).solve(EDGE)
    assert beyond.converged and abs(beyond.positions[-1, 1]) > 0.05


@pytest.mark.every(4)
@pytest.mark.parametrize(('angle', 'curvature', 'between', 'factors'), [
    (np.pi / 2, 6.0, (12, 15), (0.95, 0.97, 0.99)), (np.pi / 2, 6.0, (25, 30), (1.01, 1.03, 1.05)),
    (0.0, -3.0, (7, 10), (0.95, 0.97, 0.99)), (0.0, -3.0, (13, 16), (1.01, 1.03, 1.05))],
    ids=['curl leaves', 'curl returns', 'arch leaves', 'arch returns'])
def test_bend_and_twist_of_a_naturally_curved_rod(angle, curvature, between, factors):
    # heavy enough it leaves its plane, heavier still it comes back to it
    reference = critical(lambda load: Planar(load=load, curvature=curvature, angle=angle), 0.75,
                         between)
    gripper = Pose((0, 0, 0), Rotation.from_euler('y', angle).as_quat())

    def rod(factor):
        return Rod(1.0, factor * reference / G, 1.0, 0.75, natural_curvature=(curvature, 0.0))

    assert indifferent(rod, gripper, factors) == pytest.approx(1.0, abs=1e-3)
    inside = 2 - factors[-1] + (0.04 if factors[-1] < 1 else -0.04)
    turned = DirectSimulator(rod(inside)).solve(gripper)
    assert turned.converged and np.abs(turned.positions[:, 1]).max() > 1e-3


def test_euler_column():
    loads = np.array([0.3, 0.6, 0.9])
    values = [DirectSimulator(Rod(1.0, 0.0, 1.0, 0.75, tip_mass=factor * np.pi**2 / 4 / G)
                              ).solve(UP).stability for factor in loads]
    assert np.roots(np.polyfit(loads, values, 1))[0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.every(3)
@pytest.mark.parametrize(('tension', 'n_elements'), [(1.0, 96), (20.0, 96), (25.0, 96), (50.0, 96),
                                                     (400.0, 192)])
def test_twist_that_makes_a_rod_under_tension_writhe(tension, n_elements):
    critical_moment = moment_that_buckles(tension)
    assert moment_that_buckles(0.0) == pytest.approx(8.98682, abs=1e-5)
    assert critical_moment > 2 * np.sqrt(tension)  # Greenhill's, of an endless rod
    # a pose tells turns of less than half a turn: 9 turns in steps of 2.3 rad
    factors = np.append(np.arange(0.04, 0.94, 0.04), [0.94, 0.96, 0.98])
    direct = DirectSimulator(Rod(1.0, 0.0, 1.0, 0.7), basis='local', n_elements=n_elements,
                             gravity=(0, 0, 0), point_loads=[PointLoad((tension, 0, 0))])

    def turned(factor):
        turn = Rotation.from_rotvec([factor * critical_moment / 0.7, 0, 0])
        return FarEnd(Pose((1, 0, 0), turn.as_quat()), 'sleeve')

    shapes = direct.track([HERE] * len(factors), far_ends=[turned(one) for one in factors])
    assert all(shape.converged and not shape.jumped for shape in shapes)
    found = np.roots(np.polyfit(factors[-3:], [one.stability for one in shapes[-3:]], 2))
    assert found[np.argmin(np.abs(found - 1))] == pytest.approx(1.0, abs=2e-3)
    fallen = direct.track([HERE], initial=shapes[-1], far_ends=[turned(1.02)])[0]
    assert fallen.jumped  # and sheds turns through a loop, as nothing keeps it from itself
    assert fallen.energy < 0.9 * shapes[-1].energy


def test_ten_terms_do_not_hide_that_a_rod_writhes():
    # the series' mode bears 1 % more; the default accuracy looks at a local mesh near instability
    tension = 50.0
    critical_moment = moment_that_buckles(tension)
    direct = DirectSimulator(Rod(1.0, 0.0, 1.0, 0.7), gravity=(0, 0, 0),
                             point_loads=[PointLoad((tension, 0, 0))])
    factors = np.append(np.arange(0.1, 0.95, 0.1), [0.95, 0.995, 1.005])
    ends = [FarEnd(Pose((1, 0, 0), Rotation.from_rotvec(
        [factor * critical_moment / 0.7, 0, 0]).as_quat()), 'sleeve') for factor in factors]
    shapes = direct.track([HERE] * len(ends), far_ends=ends)
    assert all(shape.converged for shape in shapes)
    assert [bool(shape.jumped) for shape in shapes] == [False] * (len(ends) - 1) + [True]


def test_a_localized_helix():
    # endless rod: M^2 = 2 EI T (1 + cos of the largest angle to the axis) (Coyne; van der Heijden)
    direct = DirectSimulator(Rod(1.0, 0.0, 1.0, 0.7), basis='local', n_elements=128,
                             gravity=(0, 0, 0))
    ends = [Pose((x, 0, 0), (0, 0, 0, 1)) for x in (0.99, 0.96)] + [
        Pose((0.92, 0, 0), Rotation.from_rotvec([turn, 0, 0]).as_quat())
        for turn in np.arange(0.0, 55.0, 1.5)]
    shapes = direct.track([HERE] * len(ends), far_ends=ends)
    assert all(shape.converged for shape in shapes)
    force, moment = shapes[-1].far_wrench[0], shapes[-1].far_wrench[3]
    steepest = shapes[-1].tangents[:, 0].min()
    assert force > 300 and steepest < 0.8
    assert moment**2 / (2 * force * (1 + steepest)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.every(2)
@pytest.mark.parametrize('options', [{}, {'basis': 'local', 'n_elements': 128}])
def test_an_arch_between_clamps_snaps_through(options):
    slack = 0.05
    star = arch_that_snaps(slack)
    # of a shallow arch 1.7818 (Gomez, Moulton, Vella 2017), of this one 0.14 % more
    assert arch_that_snaps(1e-4) / 1e-2 == pytest.approx(1.7818, rel=1e-3)
    strip = DirectSimulator(Rod(1.0, 0.0, (1.0, 100.0), 100.0), gravity=(0, 0, 0), **options)
    factors = np.array([-0.6, -0.3, 0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.998, 1.002])
    shapes = strip.track(
        [Pose((0, 0, 0), Rotation.from_euler('y', -one * star).as_quat()) for one in factors],
        far_ends=[Pose((1 - slack, 0, 0), (0, 0, 0, 1))] * len(factors))
    assert all(shape.converged for shape in shapes)
    assert [bool(shape.jumped) for shape in shapes] == [False] * 10 + [True]
    assert shapes[-2].at(0.5).position[2] < -0.05 and shapes[-1].at(0.5).position[2] > 0.1


def test_a_step_close_to_the_fold_takes_no_more_than_any_other():
    # the step leads up the potential: without its grip the arch could not stand
    star = 0.39897
    strip = DirectSimulator(Rod(1.0, 0.0, (1.0, 100.0), 100.0), gravity=(0, 0, 0))
    factors = np.array([0.0, 0.6, 0.9, 0.98, 0.99, 0.997])
    shapes = strip.track(
        [Pose((0, 0, 0), Rotation.from_euler('y', -one * star).as_quat()) for one in factors],
        far_ends=[Pose((0.95, 0, 0), (0, 0, 0, 1))] * len(factors))
    assert all(shape.converged and not shape.jumped for shape in shapes[1:])
    assert max(shape.iterations for shape in shapes[-2:]) < 15  # a search used to take 1000


def test_a_dlo_comes_to_lie_round_a_bar_without_a_gap():
    # first at a point, then along an element that bends as the bar does, then at its two ends
    radius, thin = 0.1, 5e-4
    bar = Capsule((0, -0.3, -radius - thin), (0, 0.3, -radius - thin), radius, 0.1)
    rod = Rod(1.0, 0.0, 5e-3, 5e-3, radius=thin, tip_mass=1 / G)
    direct = DirectSimulator(rod, basis='local', n_elements=64, obstacles=[bar])
    ways = [Pose((-0.3, 0, z), (0, 0, 0, 1)) for z in np.linspace(0.035, 0.005, 13)]
    shapes = direct.track(ways)
    assert all(shape.converged for shape in shapes)
    counts = [len(shape.contacts) for shape in shapes]
    assert counts[1] == 1 and max(counts) > 2 and counts[-1] == 2
    assert all(0.374 < one.s < 0.3925 for shape in shapes[1:] for one in shape.contacts)
    pressed = [sum(one.force * one.normal for one in shape.contacts) for shape in shapes]
    steps = np.linalg.norm(np.diff(pressed, axis=0), axis=1)
    assert steps.max() < 0.1  # N of 1.3 N: the force spreads, it does not leap
    for shape in shapes:
        depth = max(radius + thin - np.linalg.norm(
            shape.at(s).position[[0, 2]] - [0, -radius - thin]) for s in np.linspace(0.3, 0.5, 99))
        assert depth < 2e-6


@pytest.mark.every(3)
@pytest.mark.parametrize(('tension', 'friction', 'n_elements'), [
    (10, 0.1, 48), (10, 0.0, 64), (100, 0.1, 64), (1000, 0.0, 48), (1000, 0.3, 64)])
def test_a_soft_dlo_comes_to_lie_round_a_bar_in_every_step(tension, friction, n_elements):
    # the choice of points that may touch went round in circles; springs were too stiff to tell
    radius, thin = 0.1, 5e-4
    stiffness = radius**2 / tension
    bar = Capsule((0, -0.3, -radius - thin), (0, 0.3, -radius - thin), radius, friction)
    rod = Rod(1.0, 0.0, stiffness, stiffness, radius=thin, tip_mass=1 / G)
    direct = DirectSimulator(rod, basis='local', n_elements=n_elements, obstacles=[bar])
    way = [(-0.3, z) for z in np.linspace(0.14, 0.0, 8)] + [(-0.305, 0.0), (-0.31, 0.0)]
    shapes = direct.track([Pose((x, 0, z), (0, 0, 0, 1)) for x, z in way])
    assert all(shape.converged and shape.contacts for shape in shapes)
    for shape in shapes:
        places = shape.positions_at(np.linspace(0.2, 0.65, 999))[:, [0, 2]]
        away = np.linalg.norm(places - [0, -radius - thin], axis=1) - radius - thin
        assert away.min() > -5e-6


@pytest.mark.every(3)
@pytest.mark.parametrize('friction', [0.1, 0.3, 0.5])
@pytest.mark.parametrize('wrapped', [90, 180, 270])
def test_capstan(friction, wrapped):
    assert capstan(1e-9, friction, 0.1, 1.5) == pytest.approx(np.exp(1.5 * friction), rel=1e-4)
    radius, thin = 0.1, 5e-4
    # around a quarter of the bar only a soft one touches it at many points
    stiffness, elements = (5e-4, 192) if wrapped == 90 else (5e-3, 96)
    axis = np.array([0, 0, -radius - thin])
    bar = Capsule((0, -0.3, axis[2]), (0, 0.3, axis[2]), radius, friction)
    rod = Rod(1.4, 0.0, stiffness, stiffness, radius=thin, tip_mass=1 / G)
    direct = DirectSimulator(rod, basis='local', n_elements=elements, obstacles=[bar])
    way = [Pose((x, 0, z), (0, 0, 0, 1))
           for x, z in [*((-0.3, z) for z in np.linspace(0.14, 0.0, 8)), (-0.305, 0.0)]]
    for angle in range(3, wrapped - 89, 3):  # the gripper goes round the bar
        turn = Rotation.from_euler('y', -angle, degrees=True)
        way.append(Pose(axis + turn.apply([-0.305, 0, 0] - axis), turn.as_quat()))
    last = way[-1]
    way += [Pose(last.position - pulled * last.rotation[:, 0], last.quaternion)
            for pulled in (0.004, 0.008, 0.012)]
    shapes = direct.track(way)
    assert all(shape.converged for shape in shapes)
    shape = shapes[-1]
    assert len(shape.contacts) >= 8
    x, z = shape.gripper_wrench[[0, 2]]
    turned = (np.pi / 2 + np.arctan2(-z, -x)) % (2 * np.pi)
    assert round(2 * turned / np.pi) == wrapped // 90
    assert np.hypot(x, z) == pytest.approx(capstan(stiffness, friction, radius + thin, turned),
                                           rel=5e-3)
