# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""DLOs that are held anywhere: clips, clamps and pins inside, beside what holds the tip."""

import pickle
from dataclasses import replace
from math import pi, sin

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Hold,
    InvalidTask,
    PointLoad,
    Pose,
    Rod,
    Sphere,
    solve_many,
)
from dlo_planner.direct.search import evaluated
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, pack, unpack
from dlo_planner.direct.storage import pose_row
from dlo_planner.energy.terms import roundoff
from dlo_planner.model.holds import GRIPS, holds_of, spans_of
from dlo_planner.model.pose import displaced
from dlo_planner.view.scene import shape_primitives

HERE = Pose.looking_along((0, 0, 0.5), (1, 0, 0.4))
END = FarEnd(Pose.looking_along((0.7, 0.1, 0.5), (1, 0.2, -0.4)))
CABLE = Rod(1.0, 0.075, (0.02, 0.018), 0.015)


def bent(**options):
    """Return a simulator, and its DLO in two grips."""
    simulator = DirectSimulator(CABLE, **({'n_elements': 32, 'basis': 'local'} | options))
    return simulator, simulator.solve(HERE, far_end=END)


def at(x):
    return Pose((x, 0, 0), (0, 0, 0, 1))


def moved_by(pose, *twist):
    return displaced(pose, np.array(twist, dtype=float))


def near(shape, s, grip, rng, by='fixture'):
    """Return a Hold next to where a Shape is."""
    pose = shape.at(float(shape.s[-1]) if s is None else s)
    twist = np.concatenate([0.1 * rng.normal(size=3), 0.01 * rng.normal(size=3)])
    return Hold(displaced(pose, twist), grip, s, by=by)


# ---- against what others know ---------------------------------------------------------------


@pytest.mark.parametrize('degrees', [20, 60, 100])
def test_an_elastica_between_two_pins_inside(degrees):
    # Love, art. 262; Timoshenko and Gere, Theory of Elastic Stability, 2.7: its slope at the pins
    # is the angle, k = sin(angle / 2), P / P_Euler = (2 K / pi)^2, the pins 2 E / K - 1 lengths
    # apart. The gripper holds along the slope: what is before the first pin bears nothing
    angle, length, stiff = np.radians(degrees), 0.6, 0.04
    m = sin(angle / 2) ** 2
    span = (2 * ellipe(m) / ellipk(m) - 1) * length
    along = np.array([np.cos(angle), 0, np.sin(angle)])
    holds = [Hold(at(0.0), 'pinned', 0.2), Hold(at(span), 'pinned', 0.8)]
    simulator = DirectSimulator(Rod(1.0, 0.0, stiff, 0.03), n_elements=400, basis='local')
    shape = simulator.solve(Pose.looking_along(-0.2 * along, along), holds=holds)
    assert shape.converged
    force = (2 * ellipk(m)) ** 2 * stiff / length**2
    assert shape.wrenches[1, 0] == pytest.approx(-force, rel=1e-4)
    moments = [shape.gripper_wrench[3:], *shape.wrenches[:, 3:]]
    np.testing.assert_allclose(moments, 0, atol=1e-5 * force * length)


@pytest.mark.parametrize('guided', [True, False])
def test_a_column_of_two_spans_buckles_at_eulers_load(guided):
    # a sleeve between them holds the slope: of both spans the longer one buckles, 4 pi^2 EI / l^2
    # between two such, pi^2 EI / 4 l^2 with a free end; stability is 1 - P / P_critical there
    inside, stiff = 0.4, 0.05
    critical = (4 if guided else 1 / 4) * pi**2 * stiff / (1 - inside) ** 2
    holds = [Hold(at(inside), 'sleeve', inside), *([FarEnd(at(1.0), 'sleeve')] if guided else [])]

    def loaded(part):
        simulator = DirectSimulator(Rod(1.0, 0.0, stiff, 0.04), n_elements=100, basis='local',
                                    point_loads=[PointLoad((-part * critical, 0, 0))])
        return simulator.solve(at(0.0), holds=holds)

    one, other = loaded(0.97), loaded(0.99)
    assert one.converged and other.converged and np.abs(other.positions[:, 1:]).max() < 1e-9
    zero = 0.97 + 0.02 * one.stability / (one.stability - other.stability)
    assert zero == pytest.approx(1, abs=2e-3)
    beyond = loaded(1.02)
    assert beyond.converged and np.abs(beyond.positions[:, 1:]).max() > 0.01


@pytest.mark.parametrize('seed', range(4))
def test_a_clamp_inside_parts_the_dlo(seed):
    rng = np.random.default_rng(seed)
    simulator, base = bent()
    inside = float(simulator.mesh.s[14])
    clamp, end = near(base, inside, 'clamped', rng), near(base, None, GRIPS[seed], rng)
    shape = simulator.solve(HERE, holds=[end, clamp])
    assert shape.converged and shape.holds == (clamp, end)
    found = []  # two DLOs, each with the elements that it has here
    for length, elements, gripper, hold in (
            (inside, 14, HERE, FarEnd(clamp.pose)),
            (1 - inside, 18, clamp.pose, FarEnd(end.pose, end.grip))):
        alone = DirectSimulator(replace(CABLE, length=length), n_elements=elements, basis='local')
        found.append(alone.solve(gripper, far_end=hold))
        assert found[-1].converged
    np.testing.assert_allclose(shape.positions[:15], found[0].positions, rtol=0, atol=1e-9)
    np.testing.assert_allclose(shape.positions[14:], found[1].positions, rtol=0, atol=1e-9)
    assert shape.stability == pytest.approx(min(part.stability for part in found), rel=1e-3)


@pytest.mark.parametrize('grips', [('pinned',), ('aligned', 'clamped'), ('sleeve', 'pinned'),
                                   ('pinned', 'sleeve', 'aligned')])
def test_what_holds_bears_the_weight(grips, rng):
    simulator, base = bent()
    places = [float(simulator.mesh.s[k]) for k in (9, 18, 27)][:len(grips)]
    holds = [near(base, s, grip, rng) for s, grip in zip(places, grips, strict=True)]
    shape = simulator.solve(HERE, holds=holds)
    assert shape.converged and shape.far_end is None and not shape.far_wrench.any()
    held = [shape.at(s).position for s in places]
    h = np.diff(shape.s)
    mass = 0.075 * 0.5 * (np.append(0, h) + np.append(h, 0))
    weight = mass[:, None] * [0, 0, -9.81]
    force = shape.gripper_wrench[:3] + shape.wrenches[:, :3].sum(axis=0) + weight.sum(axis=0)
    size = np.abs(shape.wrenches).max()
    np.testing.assert_allclose(force, 0, atol=1e-8 * size)
    moment = (shape.gripper_wrench[3:] + shape.wrenches[:, 3:].sum(axis=0)
              + np.cross(np.array(held) - HERE.position, shape.wrenches[:, :3]).sum(axis=0)
              + np.cross(shape.positions - HERE.position, weight).sum(axis=0))
    np.testing.assert_allclose(moment, 0, atol=1e-8 * size)
    for hold, place, wrench in zip(holds, held, shape.wrenches, strict=True):
        away, axis = place - hold.pose.position, hold.pose.direction
        if hold.grip == 'sleeve':
            assert abs(wrench[:3] @ axis) < 1e-8 * size
            away = away - (away @ axis) * axis
        np.testing.assert_allclose(away, 0, atol=1e-9)
        if hold.grip != 'pinned':
            np.testing.assert_allclose(shape.at(hold.s).direction, axis, atol=1e-8)
        if hold.grip == 'aligned':
            assert abs(wrench[3:] @ axis) < 1e-8 * size


@pytest.mark.parametrize('grip', GRIPS)
def test_it_answers_to_each_hold(grip, rng):
    simulator, base = bent()
    holds = [near(base, float(simulator.mesh.s[11]), grip, rng),
             near(base, float(simulator.mesh.s[22]), 'pinned', rng), near(base, None, grip, rng)]
    shape = simulator.solve(HERE, holds=holds)
    answers, step = Sensitivity(shape), 1e-5
    columns = answers.by_grips(0.52)
    assert columns.shape == (6, 24)
    np.testing.assert_array_equal(columns[:, :6], answers.at(0.52))
    strains = np.concatenate([answers.strains, answers.strains_by_holds], axis=2)

    def there(twist):
        moved = [Hold(displaced(hold.pose, twist[6 * k:6 * k + 6]), hold.grip, hold.s)
                 for k, hold in enumerate(holds, start=1)]
        found = simulator.solve(displaced(HERE, twist[:6]), shape, holds=moved)
        assert found.converged
        return *found.frame_at(0.52), found.element_strains

    for column in range(24):
        (turned, place, one), (turned_back, place_back, other) = (
            there(way * step * np.eye(24)[column]) for way in (1, -1))
        turn = turned @ turned_back.T
        twist = np.concatenate([0.5 * (turn - turn.T)[[2, 0, 1], [1, 2, 0]],
                                place - place_back]) / (2 * step)
        np.testing.assert_allclose(columns[:, column], twist, rtol=0,
                                   atol=5e-6 * max(np.abs(twist).max(), 1))
        slope = (one - other) / (2 * step)
        np.testing.assert_allclose(strains[:, :, column], slope, rtol=0,
                                   atol=5e-6 * max(np.abs(slope).max(), 1))


def test_a_pinned_gripper_and_a_pin_inside(rng):
    # both sides of the pin, clamped where it was found, are where they are; the pin bears no moment
    simulator = DirectSimulator(CABLE, n_elements=32, basis='local', grip='pinned')
    base = simulator.solve(HERE, far_end=END)
    inside = float(simulator.mesh.s[12])
    pin, end = near(base, inside, 'pinned', rng), near(base, None, 'clamped', rng)
    shape = simulator.solve(HERE, holds=[pin, end])
    assert shape.converged
    np.testing.assert_allclose(shape.wrenches[0, 3:], 0, atol=1e-12)
    np.testing.assert_allclose(shape.gripper_wrench[3:], 0, atol=1e-9)
    clamped = DirectSimulator(CABLE, n_elements=32, basis='local').solve(
        shape.gripper, shape, holds=[Hold(shape.at(inside), 'clamped', inside), end])
    np.testing.assert_allclose(clamped.positions, shape.positions, rtol=0, atol=1e-10)


# ---- from step to step ------------------------------------------------------------------------


def test_holds_are_followed(rng):
    simulator, base = bent()
    clip = near(base, float(simulator.mesh.s[13]), 'aligned', rng)
    shape = simulator.solve(HERE, holds=[clip, END])
    moved = Hold(moved_by(clip.pose, 0.01, 0, 0.01, 0.003, 0, 0.002), 'aligned', clip.s)
    warm, cold = (simulator.solve(HERE, start, holds=[moved, END]) for start in (shape, None))
    assert warm.converged and warm.iterations <= 8
    np.testing.assert_allclose(warm.positions, cold.positions, rtol=0, atol=1e-9)
    tracked = simulator.track([HERE] * 2, initial=shape, holds=[[clip, END], [moved, END]])
    np.testing.assert_array_equal(tracked[1].positions, simulator.solve(
        HERE, tracked[0], holds=[moved, END]).positions)
    resting = simulator.track([HERE] * 2, holds=(clip, END))
    assert [one.holds for one in resting] == [(clip, END)] * 2


def test_what_is_let_go_and_what_is_gripped_anew(rng):
    simulator, base = bent()
    clip = near(base, float(simulator.mesh.s[13]), 'pinned', rng)
    both = simulator.solve(HERE, base, holds=[clip, END])
    assert both.converged
    again = simulator.solve(HERE, both, far_end=END)
    assert again.converged and again.holds == (END,)
    np.testing.assert_allclose(again.positions, base.positions, rtol=0, atol=1e-8)
    other = near(base, float(simulator.mesh.s[20]), 'clamped', rng)
    regrasped = simulator.solve(HERE, both, holds=[other, END])
    assert regrasped.converged
    np.testing.assert_allclose(regrasped.positions, simulator.solve(
        HERE, holds=[other, END]).positions, rtol=0, atol=1e-8)


@pytest.mark.parametrize('slack', [1e-2, 1e-4, 1e-6])
def test_taut_from_clip_to_clip(slack):
    # three spans in a zigzag, as taut as that, set down at once
    corners = np.array([[0, 0, 0], [0.35, 0.05, 0.02], [0.66, -0.06, 0], [1.0, 0.02, 0.05]])
    ways = np.diff(corners, axis=0)
    sizes = np.linalg.norm(ways, axis=1)
    s = np.cumsum(sizes / (1 - slack))
    rod = Rod(float(s[-1]), 0.05, 0.01, 0.008)
    holds = [Hold(Pose(corners[1], (0, 0, 0, 1)), 'pinned', float(s[0])),
             Hold(Pose.looking_along(corners[2], ways[1]), 'clamped', float(s[1])),
             FarEnd(Pose(corners[3], (0, 0, 0, 1)), 'pinned')]
    shape = DirectSimulator(rod, accuracy=1e-4).solve(
        Pose.looking_along(corners[0], ways[0]), holds=holds)
    assert shape.converged
    assert shape.error_estimate <= 1e-4
    # the tension of the last span, of a string that sags by its weight and bends into the clamp
    assert shape.wrenches[-1, :3] @ ways[2] / sizes[2] > 0.02 / slack**0.5


def test_what_is_out_of_reach_is_named():
    simulator, _ = bent()
    far = Hold(Pose((0.5, 0, 0.5), (0, 0, 0, 1)), 'pinned', 0.3, by='clip 2')
    shape = simulator.solve(HERE, holds=[far, FarEnd(Pose((0.6, 0, 0.5), (0, 0, 0, 1)))])
    assert not shape.converged
    assert shape.status == ('out of reach: clip 2 at s = 0.3 m is 0.5 m from the gripper, the DLO '
                            'between them is 0.3 m long')
    near_one = Hold(Pose((0.2, 0, 0.5), (0, 0, 0, 1)), 'pinned', 0.3, by='clip 2')
    status = simulator.solve(HERE, holds=[near_one, FarEnd(at(1.2))]).status
    assert 'the far end is 1.11803399 m from clip 2 at s = 0.3 m' in status
    assert 'between them is 0.7 m long' in status


def test_two_sleeves_are_as_far_apart_as_their_axes():
    one = Hold(Pose.looking_along((0.2, 0, 0), (1, 0, 0)), 'sleeve', 0.3)
    other = FarEnd(Pose.looking_along((9, 5, 0.4), (0, 1, 0)), 'sleeve')
    spans = spans_of((one, other), at(0.0), 1.0)
    assert [span.distance for span in spans] == pytest.approx([0.0, 0.4])
    beside = FarEnd(Pose.looking_along((7, 0.3, 0), (1, 0, 0)), 'sleeve')
    assert spans_of((one, beside), at(0.0), 1.0)[1].distance == pytest.approx(0.3)


@pytest.mark.parametrize(('make', 'said'), [
    (lambda: Hold(at(0.1), s=-0.3), 'Hold.s'),
    (lambda: Hold((0.1, 0, 0)), 'Hold.pose'),
    (lambda: Hold(at(0.1), by=3), 'Hold.by'),
    (lambda: bent()[0].solve(HERE, holds=[Hold(at(0.1), s=1.5)]), 'at most 1 m'),
    (lambda: bent()[0].solve(HERE, far_end=END, holds=[END]), 'places at least'),
    (lambda: bent()[0].solve(HERE, holds=[Hold(at(0.1), s=1e-9)]), 'beside the gripper'),
    (lambda: bent()[0].solve(HERE, far_end=Hold(at(0.1), s=0.3)), 'others are for `holds`'),
    (lambda: bent()[0].solve(HERE, holds=[END, 'clip']), 'holds'),
    (lambda: bent()[0].track([HERE] * 3, holds=[[END]] * 2), 'holds has 2 entries'),
    (lambda: bent()[0].simulate([HERE] * 2, 0.01, holds=[[Hold(at(0.3), s=0.4)], [END]]),
     'the same places and grips'),
    (lambda: DirectSimulator(CABLE, n_elements=8, method='dfp').solve(HERE, holds=[END]),
     'method')])
def test_what_is_wrong_is_named(make, said):
    with pytest.raises(InvalidTask, match=said):
        make()


# ---- what else there is -----------------------------------------------------------------------


def test_a_series_gives_way_to_elements(rng):
    # curvature jumps at a clamp inside, which no series follows
    coarse = DirectSimulator(CABLE, n_elements=64, n_terms=10)
    pose = bent()[1].at(0.4)
    clamp = Hold(moved_by(pose, 0, 0.2, 0.1, 0.01, 0, 0), 'clamped', 0.4)
    shape = coarse.solve(HERE, holds=[clamp, END])
    assert shape.converged and shape.mesh.basis == 'local' and 0.4 in shape.s
    fine = DirectSimulator(CABLE, accuracy=1e-5).solve(HERE, holds=[clamp, END])
    assert fine.converged and fine.error_estimate <= 1e-5
    error = np.abs(shape.positions - [fine.frame_at(float(s))[1] for s in shape.s]).max()
    assert error <= 3 * shape.error_estimate < 1e-2
    assert coarse.solve(HERE, shape).mesh is coarse.mesh  # let go it hangs as before


def test_a_clamp_inside_parts_the_motion():
    # beyond it nothing moves; before it, it is the motion of a DLO that ends there
    simulator, base = bent()
    inside = float(simulator.mesh.s[16])
    clamp = Hold(base.at(inside), 'clamped', inside)
    grippers = [moved_by(HERE, 0, 0.1 * k, 0, 0, 0, 0.004 * k) for k in range(6)]
    options = {'tolerance': np.inf, 'integrator': 'paper'}
    motion = simulator.simulate(grippers, 0.02, holds=[clamp], **options)
    assert motion.converged and motion.shapes[-1].holds == (clamp,)
    half = DirectSimulator(replace(CABLE, length=inside), n_elements=16, basis='local')
    alone = half.simulate(grippers, 0.02, far_ends=[FarEnd(clamp.pose)] * 6, **options)
    for one, other in zip(motion.shapes, alone.shapes, strict=True):
        np.testing.assert_allclose(one.positions[:17], other.positions, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.positions[16:], motion.shapes[0].positions[16:], rtol=0,
                                   atol=1e-9)
    np.testing.assert_allclose(motion.work, alone.work, rtol=0, atol=1e-9)


def test_the_modes_of_a_clamp_inside_are_those_of_both_spans():
    simulator, base = bent()
    inside = float(simulator.mesh.s[12])
    clamp = Hold(base.at(inside), 'clamped', inside)
    shape = simulator.solve(HERE, holds=[clamp, END])
    parts = []
    for gripper, end, length, elements in ((HERE, FarEnd(clamp.pose), inside, 12),
                                           (clamp.pose, END, 1 - inside, 20)):
        part = DirectSimulator(replace(CABLE, length=length), n_elements=elements, basis='local')
        parts.append(part.solve(gripper, far_end=end).modes(4).frequencies)
    expected = np.sort(np.concatenate(parts))[:4]
    np.testing.assert_allclose(shape.modes(4).frequencies, expected, rtol=1e-6)


def test_it_lies_on_a_ball_between_clips(rng):
    ball = Sphere((0.35, 0.0, 0.44), 0.15)
    rod = replace(CABLE, radius=4e-3)
    simulator = DirectSimulator(rod, n_elements=40, basis='local', obstacles=[ball])
    clip = Hold(Pose.looking_along((0.62, 0, 0.42), (1, 0, -0.5)), 'aligned', 0.7)
    shape = simulator.solve(Pose.looking_along((0, 0, 0.45), (1, 0, 0.2)), holds=[clip])
    assert shape.converged and shape.contacts
    weight = 9.81 * 0.075
    lifts = shape.gripper_wrench[2] + shape.wrenches[0, 2] + sum(
        contact.vector[2] for contact in shape.contacts)
    assert lifts == pytest.approx(weight, rel=1e-7)
    distance = np.linalg.norm(shape.positions - ball.center, axis=1)
    assert distance.min() > 0.15 + 4e-3 - 1e-6


def test_rounding_does_not_count_what_holds_inside_as_a_contact():
    # an obstacle that nothing touches lets no larger residual pass, wherever the DLO is held
    rod = replace(CABLE, radius=4e-3)
    idle = Sphere((0.0, 0.0, -9.0), 0.1)
    _, base = bent()
    hold = Hold(base.at(0.5), 'clamped', 0.5)
    mesh = DirectSimulator(rod, n_elements=32, basis='local', obstacles=[idle]).mesh
    system = mesh.system(HERE.rotation, HERE.position, None, (hold, END))
    state = evaluated(system, mesh.unknowns(base.element_strains))
    of_holds = system.hold.stiffness + system.hold.turn_stiffness
    assert roundoff(system.effects, system, state, 1.0) == pytest.approx(of_holds, rel=1e-12)


def test_a_wire_yields_between_clips():
    # what a clamp parts yields by itself
    wire = Rod(0.5, 0.05, 0.02, 0.016, yield_curvature=3.0, hardening=0.1)
    simulator = DirectSimulator(wire, n_elements=50, basis='local')
    clip = Hold(at(0.195), 'clamped', 0.2)
    other = Hold(Pose.looking_along((0.455, 0, 0.03), (1, 0, 0.6)), 'clamped', 0.48)
    first = simulator.solve(at(0.0), holds=[clip])
    shape = simulator.solve(at(0.0), first, holds=[clip, other])
    assert shape.converged and shape.history.has_set
    part = DirectSimulator(replace(wire, length=0.28), n_elements=28, basis='local')
    alone = part.solve(clip.pose, part.solve(clip.pose), far_end=FarEnd(other.pose))
    assert alone.converged and alone.dissipated > 0
    assert shape.dissipated - first.dissipated == pytest.approx(alone.dissipated, rel=1e-3)
    np.testing.assert_allclose(shape.positions[20:49], alone.positions, rtol=0, atol=1e-5)
    back = simulator.solve(at(0.0), shape, holds=[clip, Hold(at(0.45), 'clamped', 0.48)])
    assert back.dissipated > shape.dissipated


def test_many_in_the_same_clips(rng):
    simulator, base = bent()
    clip = near(base, 0.4, 'pinned', rng)
    grippers = [moved_by(HERE, 0, 0, 0, 0, 0.01 * k, 0) for k in range(3)]
    shapes = solve_many(simulator, grippers, holds=[clip])
    for gripper, shape in zip(grippers, shapes, strict=True):
        alone = simulator.solve(gripper, holds=[clip])
        np.testing.assert_array_equal(shape.wrenches, alone.wrenches)
        assert shape.holds == alone.holds == (clip,)
        at_nodes = [alone.frame_at(float(s))[1] for s in shape.s]
        np.testing.assert_allclose(shape.positions, at_nodes, rtol=0, atol=1e-12)
    assert solve_many(simulator, [], holds=[clip]).wrenches.shape == (0, 1, 6)


def test_it_is_kept_in_files(tmp_path, rng):
    simulator, base = bent()
    holds = (near(base, 0.4, 'aligned', rng, by='clip 1'),
             near(base, None, 'pinned', rng, by='left arm'))
    shape = simulator.solve(HERE, holds=holds)
    for name in ('a.npz', 'a.json'):
        shape.save(tmp_path / name)
        again = Shape.load(tmp_path / name)
        assert again.holds == holds and again == pickle.loads(pickle.dumps(again))
        np.testing.assert_array_equal(again.wrenches, shape.wrenches)
        assert simulator.solve(HERE, again, holds=holds).iterations <= 2


def test_files_and_pickles_of_before_are_read():
    _, shape = bent()
    packed = pack(shape)
    for name in ('holds', 'hold_grips', 'held_by', 'wrenches'):
        del packed[name]
    packed |= {'far_end': pose_row(END.pose), 'far_grip': 'clamped',
               'far_wrench': shape.far_wrench}
    old = unpack({name: np.asarray(one) for name, one in packed.items()})
    assert old.far_end == END and old.holds == (END,)
    np.testing.assert_array_equal(old.far_wrench, shape.far_wrench)
    bare = {name: np.asarray(one) for name, one in packed.items() if name not in (
        'far_end', 'far_grip')} | {'far_wrench': np.zeros(6)}
    assert unpack(bare).holds == ()
    # a pickle of before knows pose and grip, and the module where FarEnd was
    text = pickle.dumps(END, protocol=0).replace(b'dlo_planner.model.holds',
                                                 b'dlo_planner.model.supports')
    known = pickle.loads(text)
    known.__dict__.pop('s', None), known.__dict__.pop('by', None)
    assert known == END and isinstance(known, FarEnd) and isinstance(known, Hold)


def test_the_order_is_that_of_the_places():
    tip = Hold(at(1.0), 'pinned')
    one, other = Hold(at(0.2), s=0.2), Hold(at(0.5), s=0.5)
    assert holds_of(None, [tip, other, one], 1.0) == (one, other, tip)
    assert holds_of(END, [other], 1.0) == (other, END)
    assert holds_of(None, [Hold(at(1.0), 'pinned', 1.0)], 1.0) == (tip,)


def test_a_hold_is_seen(rng):
    simulator, base = bent()
    shape = simulator.solve(HERE, holds=[near(base, 0.4, 'pinned', rng, by='clip 1'), END])
    assert 'clip 1 at s = 0.4 m, pinned, force' in shape.summary()
    assert 'the far end, clamped, moment' in shape.summary()
    drawn = [one for one in shape_primitives(shape) if one.group.startswith('hold')]
    assert [one.kind for one in drawn] == ['points', 'text', 'arrow', 'text']
    np.testing.assert_allclose(drawn[0].points[0], shape.holds[0].pose.position)
    force = np.linalg.norm(shape.wrenches[0, :3])
    assert drawn[1].text == f'clip 1 {force:.3g} N'
