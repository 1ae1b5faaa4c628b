# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Stability in contact: the Lagrangian's Hessian where contacts that bear stay closed.

Energy and gaps are written here anew, with SciPy's rotations; second derivatives are differences.
"""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, DirectSimulator, Plane, Pose, Rod, Sphere

N, RADIUS, STEP = 8, 5e-3, 1e-3
DOWN = Pose.looking_along((0, 0, 0), (0.1, 0, -1))


def places(rod, gripper, strains):
    """Return a function of the arc length: the axis of exact arcs, by SciPy's rotations."""
    h = rod.length / N
    frames, ends = [gripper.rotation], [gripper.position]

    def along(e, length):
        u = strains[e]
        size = np.linalg.norm(u)
        turn = Rotation.from_rotvec(length * u).as_matrix()
        if size * length < 1e-9:
            return frames[e] @ [length, 0, 0], turn
        cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
        angle = size * length
        mean = (length * np.eye(3) + (1 - np.cos(angle)) / size**2 * cross
                + (angle - np.sin(angle)) / size**3 * cross @ cross)
        return frames[e] @ mean[:, 0], turn

    for e in range(N):
        chord, turn = along(e, h)
        ends.append(ends[e] + chord)
        frames.append(frames[e] @ turn)

    def place(s):
        e = min(int(s / h), N - 1)
        return ends[e] + along(e, s - e * h)[0]

    return place


def distance(obstacle, x):
    if isinstance(obstacle, Plane):
        return (x - obstacle.point) @ obstacle.normal
    if isinstance(obstacle, Box):
        beyond = np.abs(obstacle.pose.rotation.T @ (x - obstacle.pose.position)) - obstacle.size / 2
        return np.linalg.norm(np.maximum(beyond, 0)) + min(beyond.max(), 0)
    if isinstance(obstacle, Sphere):
        return np.linalg.norm(x - obstacle.center) - obstacle.radius
    axis = obstacle.end - obstacle.start
    part = np.clip((x - obstacle.start) @ axis / (axis @ axis), 0, 1)
    return np.linalg.norm(x - obstacle.start - part * axis) - obstacle.radius


def functions(rod, shape, obstacles):
    """Return functions of the scaled unknowns (3 N,): potential, and the gap of each contact."""
    h, natural = rod.length / N, np.array([0.0, *rod.natural_curvature])
    scale = 1 / np.sqrt(h * np.array(rod.stiffness))
    weights = 9.81 * rod.mass_per_length * h * np.array([0.5, *np.ones(N - 1), 0.5])

    def unfolded(q):
        return places(rod, shape.gripper, natural + scale * q.reshape(N, 3))

    def potential(q):
        place = unfolded(q)
        return 0.5 * q @ q + sum(weights[k] * place(k * h)[2] for k in range(N + 1))

    def gap_of(contact):
        obstacle = obstacles[contact.obstacle]
        if abs(contact.s / h - round(contact.s / h)) < 1e-9:  # a node, which stays one
            return lambda q: distance(obstacle, unfolded(q)(contact.s)) - RADIUS

        def gap(q):
            place = unfolded(q)
            return minimize_scalar(lambda s: distance(obstacle, place(s)) - RADIUS,
                                   bounds=(contact.s - 0.3 * h, contact.s + 0.3 * h),
                                   method='bounded', options={'xatol': 1e-10}).fun
        return gap

    q = ((shape.element_strains - natural) / scale).ravel()
    return q, potential, [gap_of(contact) for contact in shape.contacts]


def differences(values, q):
    """Return the gradients (K, m) of K functions, and the function that returns (m, m) of one."""
    def at(*moves):
        moved = q.copy()
        for i, sign in moves:
            moved[i] += sign * STEP
        return moved

    gradients = np.array([[(value(at((i, 1))) - value(at((i, -1)))) / (2 * STEP)
                           for i in range(q.size)] for value in values])

    def hessian(value):
        out = np.empty((q.size, q.size))
        for i, j in combinations_with_replacement(range(q.size), 2):
            out[i, j] = out[j, i] = (
                value(at((i, 1), (j, 1))) - value(at((i, 1), (j, -1)))
                - value(at((i, -1), (j, 1))) + value(at((i, -1), (j, -1)))) / (4 * STEP**2)
        return out

    return gradients, hessian


def touched(kind):
    """Return rod, obstacles and the grippers through which it comes to touch them."""
    rod = Rod(1.0, 0.05, (0.1, 0.2), 0.08, natural_curvature=(0.3, -0.5), radius=RADIUS)
    level = [Pose((0, 0, z), (0, 0, 0, 1)) for z in (0.0, -0.05)]
    if kind == 'ball':
        return rod, [Sphere((0.55, 0.02, -0.25), 0.1)], level[:1]
    if kind == 'bar':
        return rod, [Capsule((0.5, -1, -0.25), (0.6, 1, -0.2), 0.05)], level
    if kind == 'box':
        return rod, [Box(Pose((0.55, 0, -0.25), (0.1, 0.2, 0.3, 0.9)), (0.2, 0.3, 0.1))], (
            level[:1])
    if kind == 'floor':
        return rod, [Plane((0, 0, -0.25), (0, 0.1, 1))], level
    # a column on a slope, pressed: hardly stable
    column = Rod(1.0, 0.05, (0.1, 0.1), 0.08, natural_curvature=(0.05, 0.05), radius=RADIUS)
    return column, [Plane((0, 0, -1), (0.3, 0, 1))], [
        Pose((0, 0, -z), DOWN.quaternion) for z in (-0.2, -0.1, 0.0, 0.02)]


@pytest.mark.every(5)
@pytest.mark.parametrize('kind', ['ball', 'bar', 'box', 'floor', 'column'])
def test_stability_is_the_least_eigenvalue_with_contacts_that_stay_closed(kind):
    rod, obstacles, grippers = touched(kind)
    direct = DirectSimulator(rod, basis='local', n_elements=N, obstacles=obstacles)
    shape = direct.track(grippers)[-1]
    assert shape.converged and shape.contacts
    q, potential, gaps = functions(rod, shape, obstacles)
    forces = [contact.force for contact in shape.contacts]

    def lagrangian(at):
        return potential(at) - sum(f * gap(at) for f, gap in zip(forces, gaps, strict=True))

    gradients, hessian = differences([lagrangian, *gaps], q)
    np.testing.assert_allclose(gradients[0], 0, atol=1e-5)  # in balance
    free = null_space(gradients[1:])
    least = np.linalg.eigvalsh(free.T @ hessian(lagrangian) @ free)[0]
    assert shape.stability == pytest.approx(least, rel=1e-3, abs=1e-4)


def test_contacts_that_meet_within_a_step_leave_no_doubt_about_stability():
    # one edge, two contacts, which roll to the same place: all of their force is then on one
    box = Box(Pose((-0.3768, 0.1503, 0.1456), (0.2862, -0.16107, 0.9105, 0.25127)),
              (0.0807, 0.4, 0.1))
    simulator = DirectSimulator(Rod(1.0, 0.05, (0.5096, 0.4402), 0.8172, radius=5e-4),
                                obstacles=[box])
    corners = [((0, 0, 0), (0.3097, 0.5821, 0.7503, -0.0483)),
               ((-0.0158, 0.0096, -0.0415), (0.3097, 0.5821, 0.7503, -0.0483)),
               ((-0.0065, 0.0136, -0.0441), (0.2693, 0.4772, 0.8365, 0.0029)),
               ((-0.0019, 0.0156, -0.0454), (0.2467, 0.4206, 0.8726, 0.0286)),
               ((0.0028, 0.0175, -0.0467), (0.2227, 0.3615, 0.9038, 0.0542))]
    poses = [Pose(place, turn / np.linalg.norm(turn)) for place, turn in corners]
    *_, before, shape = simulator.track(poses)
    assert [len(one.contacts) for one in (before, shape)] == [2, 1]
    again = simulator.solve(shape.gripper, shape)
    assert again.stability == pytest.approx(shape.stability, rel=1e-3)


def test_a_contact_rolls_through_a_node_and_stability_with_it():
    # a wire between two grips over a bar beneath its middle, where a node is: that touches, too,
    # but carries nothing and holds nothing
    wire = Rod.circular(0.6, 2e-3, 8960.0, 110e9, 0.34)
    here, there = (Pose((x, 0, 0.3), (0, 0, 0, 1)) for x in (0.0, 0.5))
    free = DirectSimulator(wire, basis='local', n_elements=40).solve(here, far_end=there)
    height = free.positions[20, 2] + np.sign(free.positions[20, 2] - 0.3) * 0.01
    found = []
    for x in (-1e-6, -1e-9, 0.0, 1e-9, 1e-6):
        bar = Capsule((0.25 + x, -0.5, height), (0.25 + x, 0.5, height), 0.02)
        shape = DirectSimulator(wire, basis='local', n_elements=40, obstacles=[bar]).solve(
            here, far_end=there)
        contact, = shape.contacts
        assert shape.converged and contact.s == pytest.approx(0.3, abs=2e-6)
        found.append(shape.stability)
    np.testing.assert_allclose(found, found[0], rtol=1e-3)


@pytest.mark.parametrize('parts', [1, 4])
def test_a_node_and_the_point_that_has_come_to_it_are_one_contact(parts):
    # an arch is pressed on a floor in its middle, where a node is, or none: that changes nothing
    rod = Rod(1.0, 0.0, 1.0, 0.7, natural_curvature=(-0.5, 0.5), radius=2e-3)
    first, last = (Rotation.from_euler('y', turn).as_quat() for turn in (0.4, -0.4))
    low = DirectSimulator(rod, basis='local').solve(
        Pose((0, 0, 0), first), far_end=Pose((0.8, 0, 0), last)).positions[:, 2].min()
    ends = [[Pose((x, 0, z), turn) for z in np.linspace(0, -0.06, 4 * parts + 1)]
            for x, turn in ((0.0, first), (0.8, last))]
    found = []
    for elements in (64, 63):
        shape = DirectSimulator(
            rod, basis='local', n_elements=elements,
            obstacles=[Plane((0, 0, low - 0.01), (0, 0, 1))]).track(ends[0], far_ends=ends[1])[-1]
        contact, = shape.contacts
        assert shape.converged and contact.s == pytest.approx(0.5, abs=1e-6)
        found.append((contact.force, shape.stability))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3)
