# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A step of a DLO that bears ends where small steps end, and nothing is left inside an obstacle."""

from typing import NamedTuple

import numpy as np
import pytest

from dlo_planner import Capsule, DirectSimulator, Plane, Pose, Rod, Sphere

LEVEL = (0, 0, 0, 1)


class Scene(NamedTuple):
    """A DLO pressed onto a sphere in steps along a line; the last one is looked at."""

    rod: Rod
    sphere: Sphere
    quaternion: tuple
    step: tuple
    steps: int


SCENES = {
    'flat': Scene(Rod(1.0, 0.05, (0.1191, 0.1575), 0.8873, natural_curvature=(-0.6785, 0.1151),
                      radius=5e-4),
                  Sphere((0.3258, -0.5578, 0.2515), 0.0263, 0.2373),
                  (0.7518, -0.3801, 0.5306, 0.0937), (0.0055, 0.0043, -0.0133), 4),
    'bent': Scene(Rod(1.0, 0.05, 0.6069, 0.1133, natural_curvature=(-0.3809, -0.4543),
                      radius=5e-4),
                  Sphere((0.4564, -0.2973, -0.2905), 0.0123, 0.3224),
                  (-0.8353, 0.4096, 0.045, 0.364), (-0.005, 0.0061, -0.01275), 4),
}


@pytest.mark.parametrize('name', SCENES)
def test_a_step_does_not_fall_off_unseen(name):
    rod, sphere, quaternion, step, steps = SCENES[name]
    simulator = DirectSimulator(rod, basis='local', n_elements=64, obstacles=[sphere])

    def at(part):
        return Pose(part * np.array(step), quaternion)

    shape = simulator.solve(at(0))
    for k in range(1, steps):
        shape = simulator.solve(at(k), shape)
    whole = simulator.solve(at(steps), shape)
    for part in np.linspace(steps - 1, steps, 25)[1:]:
        shape = simulator.solve(at(part), shape)
        assert shape.converged and not shape.jumped
    assert whole.converged and not whole.jumped
    assert len(whole.contacts) == len(shape.contacts) == 1
    # a step is of first order in what friction does; the DLO that fell off was 7 cm away
    np.testing.assert_allclose(whole.positions, shape.positions, atol=3e-3)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_what_a_dlo_that_bears_comes_upon_is_not_left_inside(basis, friction):
    # it bears on the bar; the next step lays it, a little, onto another one
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    bar = Capsule((0.3, -0.5, 0.9), (0.3, 0.5, 0.9), 0.02, friction)
    alone = DirectSimulator(wire, basis=basis, n_elements=64, obstacles=[bar])
    shape = alone.track([Pose((0, 0, z), LEVEL) for z in np.linspace(1.02, 0.93, 10)])[-1]
    assert shape.contacts
    s = float(shape.s[48])
    place = alone.solve(Pose((0, 0, 0.92), LEVEL), shape).at(s).position
    for depth in (2e-5, 1e-3):  # less, and more, than what may be inside on the way
        center = place - (0, 0, 0.02 + wire.radius - depth)
        other = Capsule(center - (0, 0.5, 0), center + (0, 0.5, 0), 0.02, friction)
        both = DirectSimulator(wire, basis=basis, n_elements=64, obstacles=[bar, other])
        before = both.track([Pose((0, 0, z), LEVEL) for z in np.linspace(1.02, 0.93, 10)])[-1]
        after = both.solve(Pose((0, 0, 0.92), LEVEL), before)
        assert after.converged
        assert {contact.obstacle for contact in after.contacts} == {0, 1}
        off = np.linalg.norm((after.positions_at(np.linspace(0, 1, 2001)) - center)[:, [0, 2]],
                             axis=1)
        assert off.min() > 0.02 + wire.radius - 5e-6


def test_friction_is_that_of_the_force_that_is_reported():
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    bar = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02, 0.2)
    simulator = DirectSimulator(wire, basis='local', n_elements=64, obstacles=[bar])
    shapes = simulator.track([Pose((0, 0, z), LEVEL) for z in np.arange(1.0, 0.7, -0.01)])
    sliding = [contact for shape in shapes for contact in shape.contacts]
    assert len(sliding) > 5
    for contact in sliding:
        assert np.linalg.norm(contact.friction) <= 0.2 * contact.force * (1 + 1e-9)


def test_a_row_of_contacts_that_rubs_is_let_go_and_taken_back_within_a_step():
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    table = DirectSimulator(wire, basis='local', n_elements=64,
                            obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    ways = [(0.0, z) for z in np.arange(0.3, 0.045, -0.01)]
    ways += [(x, 0.05) for x in (0.01, 0.02, 0.03, 0.02, 0.01, 0.0)]
    shapes = table.track([Pose((x, 0, z), (0, 0, 0, 1)) for x, z in ways])
    assert all(shape.converged and not shape.jumped for shape in shapes)
    assert len(shapes[-1].contacts) > 10
    assert max(shape.iterations for shape in shapes[-12:]) <= 10  # 40 to 54 where sets alternate


def test_a_wire_rolls_on_over_a_bar_by_many_elements_in_a_step():
    radius, thin = 0.1, 5e-4
    bar = Capsule((0, -0.3, -radius - thin), (0, 0.3, -radius - thin), radius, 0.3)
    rod = Rod(1.0, 0.0, 5e-3, 5e-3, radius=thin, tip_mass=1 / 9.81)
    ways = [Pose((-0.3, 0, z), (0, 0, 0, 1)) for z in (0.14, 0.12, 0.10, 0.08)]
    forces = []
    for elements in (188, 750):
        simulator = DirectSimulator(rod, basis='local', n_elements=elements, obstacles=[bar])
        shapes = simulator.track(ways)
        assert all(shape.converged and not shape.jumped for shape in shapes)
        forces.append(sum(one.force for one in shapes[-1].contacts))
    assert forces[1] == pytest.approx(forces[0], rel=1e-3)
