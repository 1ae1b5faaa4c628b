# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cable on a table: in one grip and in two, on the mesh of the default accuracy."""

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.scenes import CABLE, GRAVITY, HELD, SCENES, beyond_cones, deepest, drawn, unbalanced
from dlo_planner import Box, Capsule, DirectSimulator, FarEnd, Plane, Pose, Rod
from dlo_planner.direct import equilibrium, statics
from dlo_planner.direct.continuation import follow
from dlo_planner.direct.discretization import even_mesh
from dlo_planner.direct.grips import between


def simulator(**how):
    """Return a USB cable above a table."""
    return DirectSimulator(CABLE, obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.5)],
                           gravity=GRAVITY, **how)


def laid(direct, count):
    """Return the last Shape of the cable as it is laid on the table, by `count` poses."""
    _, _, poses = SCENES['laid']()
    shape = None
    for pose in poses[:count]:
        shape = direct.solve(pose, shape)
        assert shape.converged
    return shape


@pytest.mark.parametrize('name', ['drawn-aside', 'both-down'])
def test_a_cable_in_two_grips_is_moved_on_a_table(name):
    (rod, bodies, poses), ends = HELD[name]()
    direct = DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY, basis='local', n_elements=64)
    shape, most = None, 0
    for pose, end in list(zip(poses, ends, strict=True))[:16]:
        shape = direct.solve(pose, shape, far_end=FarEnd(end))
        assert shape.converged
        assert deepest(shape, rod, bodies) < 5e-6
        assert unbalanced(shape, rod) < 1e-9
        assert beyond_cones(shape, bodies) < 1e-9
        most = max(most, len(shape.contacts))
    assert most >= 8


def test_a_laid_cable_keeps_a_mesh_that_tells():
    # halved elements lead to another shape where it falls: no finer mesh tells more
    shape = laid(simulator(), 16)
    assert len(shape.contacts) > 10
    assert 64 <= len(shape.element_strains) < 200


def test_the_mesh_is_judged_at_the_end_of_a_step(monkeypatch):
    direct, asked = simulator(), []
    begin = laid(direct, 10)

    def judged(shape, accuracy):
        asked.append(shape.gripper.position[2])
        return fine_enough(shape, accuracy)

    fine_enough = statics.fine_enough
    monkeypatch.setattr(statics, 'fine_enough', judged)
    there = SCENES['laid']()[2][10]
    shape = direct.solve(there, begin)
    assert len(begin.contacts) > 4 and shape.state.mesh is begin.state.mesh
    assert asked and set(asked) == {there.position[2]}


def test_its_error_is_below_the_bound_that_decides():
    direct = simulator()
    _, _, poses = SCENES['laid']()
    shape, seen = None, 0
    for pose in poses[:11]:
        shape = direct.solve(pose, shape)
        assert shape.converged
        if len(shape.contacts) >= 4:
            seen += 1
            assert shape.error_estimate < direct.accuracy
    assert seen > 3


def test_what_lies_between_two_grips_is_followed_by_two_halves():
    (rod, bodies, poses), ends = HELD['one-down']()
    direct = DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY, basis='local', n_elements=64)
    shape, asked, held = None, [], [FarEnd(end) for end in ends]

    def solve(gripper, initial, holds, most=np.inf):
        asked.append(gripper.position[2])
        return direct._taken_by(holds)(gripper, initial, holds, most)

    for pose, far_end in zip(poses[:9], held, strict=False):
        shape = direct.solve(pose, shape, far_end=far_end)
    assert len(shape.contacts) >= 4
    end = follow(solve, shape, poses[9], shape.holds)
    assert end.converged and not end.jumped
    middle = 0.5 * (poses[8].position[2] + poses[9].position[2])
    assert asked == pytest.approx([middle, poses[9].position[2]])


def test_what_lies_is_followed_by_two_halves():
    direct = simulator(basis='local', n_elements=64)
    shape, asked = laid(direct, 10), []

    def solve(gripper, initial, holds, most=np.inf):
        asked.append(gripper.position[2])
        return direct._taken_by(holds)(gripper, initial, holds, most)

    goal = Pose(shape.gripper.position - (0, 0, 0.02), shape.gripper.quaternion)
    end = follow(solve, shape, goal)
    assert end.converged and not end.jumped
    middle = 0.5 * (shape.gripper.position[2] + goal.position[2])
    assert asked == pytest.approx([middle, goal.position[2]])


# Newton steps and searches at most: those that are needed, and a third more
@pytest.mark.parametrize(('name', 'elements', 'count', 'steps', 'searches'), [
    ('peg-on-table', 64, 24, 800, 180), ('over-a-bar', 64, 11, 3500, 60),
    ('both-down', 64, 20, 1500, 100), ('one-down', 64, 20, 1700, 140),
    ('peg-on-table', None, 7, 750, 70)])
def test_what_falls_among_obstacles_is_soon_at_rest(monkeypatch, name, elements, count, steps,
                                                    searches):
    made = []

    def counting(search):
        def counted(*given):
            end = search(*given)
            made.append(equilibrium.Solution(*end).iterations)
            return end
        return counted

    for kernel in ('solve_step', 'placed_step', 'follow_step'):
        monkeypatch.setattr(equilibrium, kernel, counting(getattr(equilibrium, kernel)))
    (rod, bodies, poses), ends = HELD[name]() if name in HELD else (SCENES[name](), None)
    mesh = {} if elements is None else {'basis': 'local', 'n_elements': elements}
    direct = DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY, **mesh)
    shape, fell = None, False
    for k, pose in enumerate(poses[:count]):
        shape = direct.solve(pose, shape, far_end=FarEnd(ends[k]) if ends else None)
        assert shape.converged
        fell = fell or shape.jumped
    assert fell
    assert sum(made) < steps and len(made) < searches, (sum(made), len(made))


def test_what_comes_to_lie_between_two_nodes_is_no_deeper_than_a_contact():
    rod, bodies, poses = drawn('hose', 7)
    direct, shape = DirectSimulator(rod, obstacles=bodies, basis='local', n_elements=64), None
    for pose in poses:
        shape = direct.solve(pose, shape)
        assert shape.converged
        # at ten places of each element, by distances of their own
        assert deepest(shape, rod, bodies) < 6e-7 * rod.length


def test_forces_go_along_to_another_mesh():
    shape = laid(simulator(basis='local', n_elements=64), 12)
    past = shape.state.history
    for count in (57, 64, 150):
        s = even_mesh(1.0, count, ())
        there = past.resampled(s)
        for one, other in ((past.node_force.sum(), there.node_force.sum()),
                           ((past.node_force * past.s).sum(), (there.node_force * s).sum())):
            assert other == pytest.approx(one, rel=1e-9)
        assert (there.node_force[:, 0] == 0).all()
    assert (past.resampled(past.s).node_force == past.node_force).all()


def test_what_has_fallen_says_how_far_from_there_it_may_have_landed():
    # on elements of another length it meets a table, or a wall, in another order
    away, told, by_mesh = [], [], []
    for name in ('laid', 'cable-corner'):
        rod, bodies, poses = drawn(name, 1)
        direct, other = (DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY, basis='local',
                                         n_elements=count) for count in (64, 80))
        shapes, places = direct.track(poses[:13]), np.linspace(0.0, rod.length, 41)
        for before, shape in pairwise(shapes):
            if shape.jumped and shape.contacts:
                there = other.solve(shape.gripper, before)
                away.append(np.linalg.norm(shape.positions_at(places) - there.positions_at(places),
                                           axis=1).max() / rod.length)
                told.append(shape.error_estimate / rod.length)
                by_mesh.append(shape.state.estimate.on_mesh() / rod.length)
    assert max(away) > 0.01 and np.isfinite(told).all()
    assert (np.array(away) < 10.0 * np.array(told)).all()
    assert not (np.array(away) < 10.0 * np.array(by_mesh)).all()


def test_an_accuracy_is_that_of_where_it_has_landed():
    # where a fall ends on another mesh is no matter of this one: it is no reason to fall again
    rod, bodies, poses = drawn('cable-corner', 1)
    shapes = DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY, accuracy=1e-3).track(poses[:9])
    assert all(shape.converged for shape in shapes)
    fallen = next(shape for shape in shapes if shape.jumped)
    estimate = fallen.state.estimate
    assert estimate.where_it_lies() < 1e-3 < estimate() == fallen.error_estimate


def test_where_halved_elements_bear_elsewhere_the_mesh_is_made_finer():
    # one Newton step, which leaves contacts where they are, takes 48 elements for enough
    bar = Capsule((0.635063, -1, -0.0296483), (0.635063, 1, -0.0296483), 0.03, friction=0.2)
    direct = DirectSimulator(CABLE, gravity=GRAVITY, accuracy=1e-4, obstacles=[
        Plane((0, 0, -0.0647034), (0, 0, 1), friction=0.2), bar])
    shape = direct.solve(Pose((0, 0, 0.02), (0, 0.359787, 0, 0.933035)), far_end=(0.95, 0, 0.02))
    assert shape.converged and shape.contacts
    assert shape.error_estimate < 1e-4


def test_a_way_is_followed_in_as_many_parts_as_an_accuracy_needs():
    # two halves of this step are further from the whole of it than the accuracy
    hose = Rod.circular(1.0, 4e-3, density=1500, youngs_modulus=5e6, poisson_ratio=0.45)
    floor = Plane((0, 0, -0.2), (0, 0, 1), friction=0.2)
    direct = DirectSimulator(hose, obstacles=[floor], accuracy=1e-4)
    shape = direct.solve(Pose((0, 0, 0), (0, 0, 0, 1)))
    for moved in (direct.solve, lambda pose, before: direct.track([pose], initial=before)[0]):
        there = moved(Pose((0.02, 0.01, 0), (0, 0, 0, 1)), shape)
        assert there.converged and not there.jumped
        assert there.error_estimate <= 1e-4


def over_a_box(depth):
    """Return a simulator of a wire over a tilted box with friction, and its first shape."""
    box = Box(Pose((0.22, 0, depth), (0, 0, -0.19, 0.98)), (0.05, 1, 0.04), friction=0.5)
    direct = DirectSimulator(Rod(0.5, 0.0139, 0.0497, 0.0382, radius=7.5e-4), obstacles=[box],
                             accuracy=5e-5)
    return direct, direct.solve(Pose((0, 0, 0.01), (0, 0, 0, 1)), far_end=(0.475, 0, 0.01))


def test_one_point_that_rubs_makes_a_step_depend_on_its_way():
    direct, first = over_a_box(-0.015)
    there = Pose((0.0033, 0.0051, 0.016), (0, 0, 0, 1))
    parts, shape = first, direct.solve(there, first, far_end=(0.475, 0, 0.01))
    for part in np.arange(1, 17) / 16:
        parts = direct.solve(between(first.gripper, there, part), parts, far_end=(0.475, 0, 0.01))
    s = np.linspace(0, 0.5, 51)
    off = np.linalg.norm(shape.positions_at(s) - parts.positions_at(s), axis=1).max()
    assert len(shape.contacts) == 1
    assert 1e-6 < off < shape.error_estimate - shape.state.estimate.on_mesh() < 1e-5


def test_what_hangs_freely_does_not_remember_how_it_rubbed():
    direct, first = over_a_box(-0.023)
    shape = direct.solve(Pose((0.0033, 0.0051, -0.0042), (0, 0, 0, 1)), first,
                         far_end=(0.47, 0.0092, 0.009))
    assert first.contacts and shape.converged and not shape.contacts
    assert 0 < shape.error_estimate < 1.1e-5  # 3.5e-5 with that of the way
