# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points that roll along a DLO to where it is nearest: derivatives against differences."""

import numpy as np
import pytest
from references.blocks import dense
from test_potential import BASE, at, broad, discretized

from dlo_planner import Box, Capsule, CutOut, Cylinder, Ellipsoid, Plane, Pose, Rod, Sheet, Sphere
from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.gap import closest_point
from dlo_planner.energy.problem import new_configuration
from dlo_planner.energy.scene import AXIS
from dlo_planner.minimize.hessian import assemble, new_hessian

HOLE = CutOut(Pose.looking_along((0.1, 0.2, 0.3), (1, 1, 0)), radius=0.15)
OBSTACLES = {'plane': Plane((0, 0, -0.3), (0.1, 0, 1)), 'sphere': Sphere((0.2, 0.1, 0.1), 0.1),
             'capsule': Capsule((0.2, 0, 0), (0.3, 0.4, 0.1), 0.07),
             'box': Box(Pose((0, 0.3, 0), (0.1, 0.2, 0.3, 0.9)), (0.1, 0.2, 0.3)),
             'sheet': Sheet.around(HOLE, 0.6, 0.8, 0.0),
             'cylinder': Cylinder((0, -0.3, 0.1), (0.1, -0.3, 0.2), 0.15),
             'ellipsoid': Ellipsoid(Pose((0, -0.3, 0.1), (0.1, 0.2, 0.3, 0.9)), (0.2, 0.1, 0.15))}
ROD = Rod(1.3, 0.2, (0.3, 0.8), 0.4, natural_curvature=(1.0, -0.5), radius=0.02)
POINTS = 4


def rolling(obstacles, basis, rng, tapers):
    """Return a Problem in which points that roll push, from wherever they begin."""
    system = discretized(ROD, basis, obstacles=obstacles).system(BASE, (0.1, 0, 0.2))
    none = np.zeros((POINTS, 3))
    contacts = ContactSet(2.0, np.zeros((len(obstacles), 10)),
                          np.sort(rng.integers(0, 9, POINTS)),
                          rng.integers(0, len(obstacles), POINTS), rng.uniform(1, 2, POINTS),
                          np.zeros(POINTS), none, none, none, 0.5)
    system = system._replace(contacts=contacts)
    if tapers:
        system = system._replace(scene=system.scene._replace(
            radii=rng.uniform(0.01, 0.05, size=(9, 2))))
    return system


def pierced(system, state):
    """Whether the DLO's axis goes through a body, as nothing does: a foil's distance has no slope.

    Where it is crossed the nearest point has a distance of zero, whatever the shape.
    """
    scene, contacts = system.scene, system.contacts
    for c in range(contacts.element.size):
        o = contacts.obstacle[c]
        gap, e, fraction = closest_point(scene, contacts, c, system.lengths, state.strains,
                                         state.rotations, state.positions, np.empty(3),
                                         np.empty((3, 3)))
        radius = scene.radius
        if scene.radii.shape[0]:
            radius = scene.radii[e, 0] + fraction * (scene.radii[e, 1] - scene.radii[e, 0])
        if scene.feature[o] == AXIS and gap < -radius + 1e-6:
            return True
    return False


def compare(system, q, rng):
    """Assert gradient and Hessian at q (m, 3) along random directions."""
    _, state = at(system, q)
    hessian, step = new_hessian(system), 1e-6
    assemble(system, state, hessian)
    matrix = dense(system, hessian)
    for _ in range(8):
        direction = rng.normal(size=q.shape)
        direction /= np.linalg.norm(direction)
        (up, above), (down, below) = (at(system, q + sign * step * direction) for sign in (1, -1))
        assert np.sum(state.gradient * direction) == pytest.approx((up - down) / (2 * step),
                                                                   abs=1e-7)
        product = (matrix @ direction.ravel()).reshape(q.shape)
        np.testing.assert_allclose(product, (above.gradient - below.gradient) / (2 * step),
                                   atol=1e-6)


@pytest.mark.every(5)
@pytest.mark.parametrize('tapers', [False, True], ids=['even', 'tapered'])
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('kind', [*OBSTACLES, 'all'])
def test_a_point_that_rolls_pushes_by_the_slope_of_its_potential(kind, basis, tapers):
    obstacles = list(OBSTACLES.values()) if kind == 'all' else [OBSTACLES[kind]]
    compared = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        system = rolling(obstacles, basis, rng, tapers)
        q = rng.normal(size=new_configuration(system).q.shape)
        if pierced(system, at(system, q)[1]):
            continue
        compare(system, q, rng)
        compared += 1
    assert compared >= 8


@pytest.mark.parametrize('seed', [2, 18, 40, 42, 51])
def test_the_nearest_place_of_an_edge_stays_where_it_was_found(curly, seed):
    # once found, its rounding errors made the search go on in the rest of the element
    rng = np.random.default_rng(seed)
    system = broad(curly, 'local', rng)
    compare(system, rng.normal(size=new_configuration(system).q.shape), rng)


def test_the_nearest_place_is_found_where_the_curvature_of_the_distance_jumps():
    # beside a sheet's border, where Newton's steps go to and fro
    for seed in range(200):
        rng = np.random.default_rng(seed)
        system = rolling([OBSTACLES['sheet'], OBSTACLES['box']], 'local', rng, tapers=True)
        q = rng.normal(size=new_configuration(system).q.shape)
        if not pierced(system, at(system, q)[1]):
            compare(system, q, rng)
