# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random contacts: held and honest or refused; drawn over obstacles; falls; slides.

The family of a contact is integrated here by Runge-Kutta (Kirchhoff's equations from the contact
to the gripper, for many forces at once); the direct simulation tells what can be held. Friction is
right where Coulomb's law holds at each contact. A fall is said where long steps and short ones end
in different shapes.
"""

from dataclasses import replace
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    Cylinder,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sphere,
)
from dlo_planner.direct.shape import UNKNOWN
from dlo_planner.inverse.contact_branch import STABLE
from dlo_planner.model.rod import part_of_rod
from sweeps import MASS, Outcome, random_rod, timed
from sweeps.cutouts import MESHES

GRAVITY = np.array([0, 0, -9.81])
DRAWN_ON = ({'basis': 'local'}, {'basis': 'chebyshev'}, {'basis': 'local', 'n_elements': 32},
            {'accuracy': 1e-4})
FALLS_ON = ({}, {'basis': 'local'}, {'basis': 'local', 'n_elements': 32}, {'n_elements': 40})
MU = 0.05, 0.8
LONG = 0.01, 0.2      # of the length: steps in which it may fall
_STEPS = 64           # of Runge-Kutta
_GAP = 5e-3           # m, of the DLO above the obstacle, before it is pressed down
_PRESSED, _DRAWN, _FALLEN = 4, 8, 4  # steps
_LAW = 1e-6
_PARTS = 10           # of a long step, in which it is made once more
_SAME = 0.01          # of the length: the same shape
_SLID, _CUT = (0.02, 0.9), 0.05


# ---- contacts that are held -----------------------------------------------------------------


def random_contact(rng):
    """Return Rod, obstacle, contact (Pose) and arc length."""
    rod = replace(random_rod(rng), radius=rng.choice([2e-3, 1e-2]))
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    if rng.random() < 0.7:
        normal[2] = abs(normal[2])
    along = np.cross(normal, rng.normal(size=3))
    along /= np.linalg.norm(along)
    frame = np.column_stack([along, np.cross(normal, along), normal])
    contact = Pose.from_rotation(rng.normal(size=3), frame)
    return rod, _touched(rng, contact), contact, rng.uniform(0.2, 0.9)


def _touched(rng, contact):
    place, normal = contact.position, contact.rotation[:, 2]
    kind, radius = rng.integers(4), np.exp(rng.uniform(np.log(0.01), np.log(0.3)))
    if kind == 0:
        return Sphere(place - radius * normal, radius)
    if kind == 1:
        axis = contact.rotation[:, 1] + 0.3 * rng.normal() * contact.rotation[:, 0]
        axis /= np.linalg.norm(axis)
        middle = place - radius * normal
        return Capsule(middle - 0.5 * axis, middle + 0.5 * axis, radius)
    if kind == 2:
        return Plane(place, normal)
    return Box(Pose.from_rotation(place - 0.05 * normal, contact.rotation),
               (rng.uniform(0.02, 0.2), 0.3, 0.1))


def distance(obstacle, x):
    """Return the distances (n,) of points x (n, 3) from the surface of an obstacle."""
    if isinstance(obstacle, Sphere):
        return np.linalg.norm(x - obstacle.center, axis=1) - obstacle.radius
    if isinstance(obstacle, Capsule):
        axis = obstacle.end - obstacle.start
        part = np.clip((x - obstacle.start) @ axis / (axis @ axis), 0, 1)
        nearest = obstacle.start + part[:, None] * axis
        return np.linalg.norm(x - nearest, axis=1) - obstacle.radius
    if isinstance(obstacle, Plane):
        return (x - obstacle.point) @ obstacle.normal
    beyond = np.abs((x - obstacle.pose.position) @ obstacle.pose.rotation) - obstacle.size / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def branch(rod, contact, s, forces):
    """Return nodes (n,), strains (k, n - 1, 3), frames (k, n, 3, 3), positions (k, n, 3).

    Args:
        forces: (k,) N of contact
    """
    frame, normal = contact.rotation, contact.rotation[:, 2]
    axis = contact.position + rod.radius * normal
    tail = DirectSimulator(part_of_rod(rod, s, 1), basis='local', n_elements=_STEPS).solve(
        Pose.from_rotation(axis, frame))
    k = len(forces)
    natural = np.array([rod.natural_twist, *rod.natural_curvature])
    pull, weight = np.asarray(forces)[:, None] * normal, rod.mass_per_length * GRAVITY

    def rates(at, frames, moment):
        strain = np.einsum('nij,ni->nj', frames, moment) / rod.stiffness + natural
        cross = np.zeros((k, 3, 3))
        cross[:, 0, 1], cross[:, 0, 2] = -strain[:, 2], strain[:, 1]
        cross[:, 1, 0], cross[:, 1, 2] = strain[:, 2], -strain[:, 0]
        cross[:, 2, 0], cross[:, 2, 1] = -strain[:, 1], strain[:, 0]
        force = weight * (rod.length - at) + rod.tip_mass * GRAVITY + pull
        return frames @ cross, -np.cross(frames[:, :, 0], force), frames[:, :, 0], strain

    h = -s / _STEPS
    state = [np.tile(frame, (k, 1, 1)), np.tile(-tail.gripper_wrench[3:], (k, 1)),
             np.tile(axis, (k, 1))]
    frames, positions, strains = [state[0]], [state[2]], []
    for step in range(_STEPS):
        at = s + step * h
        a = rates(at, *state[:2])
        b = rates(at + h / 2, *(v + h / 2 * r for v, r in zip(state[:2], a, strict=False)))
        c = rates(at + h / 2, *(v + h / 2 * r for v, r in zip(state[:2], b, strict=False)))
        d = rates(at + h, *(v + h * r for v, r in zip(state[:2], c, strict=False)))
        state = [v + h / 6 * (p + 2 * q + 2 * r + t)
                 for v, p, q, r, t in zip(state, a, b, c, d, strict=False)]
        strains.append(0.5 * (b[3] + c[3]))
        frames.append(state[0])
        positions.append(state[2])

    def whole(before, beyond):
        before = np.array(before[::-1]).swapaxes(0, 1)
        return np.concatenate([before, np.tile(beyond, (k, *np.ones(beyond.ndim, int)))], axis=1)

    nodes = np.concatenate([np.linspace(0, s, _STEPS + 1), s + tail.s[1:]])
    return (nodes, whole(strains, tail.element_strains), whole(frames, tail.frames[1:]),
            whole(positions, tail.positions[1:]))


def energies(rod, nodes, strains):
    """Return the elastic energies (k,) in J of shapes with these strains (k, n - 1, 3)."""
    bent = strains - np.array([rod.natural_twist, *rod.natural_curvature])
    return 0.5 * np.einsum('e,kei,i->k', np.diff(nodes), bent**2, rod.stiffness)


def held(direct, contact, s, gripper, guess, force, stable=1e-3):
    """Return whether the direct simulation holds the contact with this force, stably."""
    shape = direct.solve(gripper, guess)
    at = [one for one in shape.contacts if abs(one.s - s) < 0.02]
    axis = contact.position + direct.rod.radius * contact.rotation[:, 2]
    return (shape.converged and shape.stability > stable and bool(at)
            and abs(sum(one.force for one in at) - force) < 0.1 * force
            and np.linalg.norm(shape.positions_at([s])[0] - axis) < 1e-3)


def scan(direct, contact, s, below=np.inf, decades=8, per_decade=10, stable=1e-3):
    """Return the forces that can be held with less than an elastic energy, of a dense scan, N."""
    rod, obstacle = direct.rod, direct.obstacles[0]
    scale = 9.81 * (rod.mass_per_length + rod.tip_mass) + min(rod.bending_stiffness)
    forces = scale * np.logspace(-3, decades - 3, decades * per_decade)
    with np.errstate(all='ignore'):  # enormous forces end in nothing
        nodes, strains, frames, positions = branch(rod, contact, s, forces)
        better = energies(rod, nodes, strains) < below
    template, found = direct.solve(Pose.identity()), []
    for k in np.flatnonzero(better & np.isfinite(positions).all(axis=(1, 2))):
        if (distance(obstacle, positions[k]) - rod.radius).min() < -1e-8:
            continue
        gripper = Pose.from_rotation(positions[k, 0], frames[k, 0])
        guess = replace(template, gripper=gripper, s=nodes, positions=positions[k],
                        frames=frames[k], element_strains=strains[k], contacts=(),
                        state=UNKNOWN)
        if held(direct, contact, s, gripper, guess, forces[k], stable):
            found.append(forces[k])
    return found


def held_or_refused(rod, obstacle, contact, s, how):
    """Return the Outcome: 'held', 'confirmed', or what is wrong."""
    direct = DirectSimulator(rod, obstacles=[obstacle], **how)
    plain = DirectSimulator(rod, obstacles=[obstacle], basis='local')
    plan, seconds = timed(InverseSimulator(direct).hold_contact, contact, s, min_force=0.0)
    if isinstance(plan, Infeasible):
        found = scan(plain, contact, s)
        if found:
            return Outcome(f'refused for nothing: {plan}; {found[0]:g} to {found[-1]:g} N hold',
                           seconds)
        return Outcome('confirmed', seconds)
    shape = plan.shapes[0]
    force = sum(one.force for one in shape.contacts)
    if not held(direct, contact, s, shape.gripper, shape, force):
        return Outcome('not held', seconds)
    fine = DirectSimulator(rod, obstacles=[obstacle], basis='local', n_elements=256)
    true = fine.solve(shape.gripper, shape)
    samples = np.linspace(0.05, 1, 20)
    error = np.abs(true.positions_at(samples) - shape.positions_at(samples)).max()
    if error > 10 * shape.error_estimate + true.error_estimate + 1e-8:
        return Outcome(f'dishonest: off by {error:.2g} m, estimates {shape.error_estimate:.2g} and '
                       f'{true.error_estimate:.2g} m', seconds)
    found = scan(plain, contact, s, 0.999 * shape.elastic_energy, 5, stable=1.2 * STABLE)
    if found:
        return Outcome(f'not the least: {found} N, not {force:.3g} N', seconds)
    return Outcome('held', seconds)


def contacts(number, seed):
    """Yield the Outcomes of random contacts."""
    rng = np.random.default_rng(seed)
    for index in range(number):
        yield held_or_refused(*random_contact(rng), MESHES[index % 3])


# ---- drawn over an obstacle -----------------------------------------------------------------


def random_obstacle(rng, place, normal, tangent, friction=None):
    """Return a ball, bar, plane or box whose surface is at a place (3,), with this normal (3,)."""
    kind, mu = rng.integers(4), np.exp(rng.uniform(*np.log(MU)))
    mu = mu if friction is None else friction
    radius = np.exp(rng.uniform(np.log(0.01), np.log(0.3)))
    if kind == 0:
        return Sphere(place - radius * normal, radius, mu)
    if kind == 1:
        axis = np.cross(normal, tangent) + 0.5 * rng.normal() * tangent
        axis /= np.linalg.norm(axis)
        middle = place - radius * normal
        return Capsule(middle - 0.5 * axis, middle + 0.5 * axis, radius, mu)
    if kind == 2:
        return Plane(place, normal, mu)
    size = np.array([rng.uniform(0.02, 0.2), 0.3, 0.1])
    frame = np.column_stack([tangent, np.cross(normal, tangent), normal])
    frame = (Rotation.from_matrix(frame) * Rotation.from_rotvec(0.3 * rng.normal(size=3)))
    return Box(Pose(place - frame.apply([0, 0, 0.05]), frame.as_quat()), size, mu)


def _below(rng, rod, start, frictions=None):
    """Return the normal (3,) of an obstacle below a place of a DLO that hangs, and the obstacle."""
    hanging = DirectSimulator(rod, basis='local').solve(start)
    s = rng.uniform(0.3, 1.0)
    tangent = hanging.at(s).rotation[:, 0]
    normal = np.cross(np.cross(tangent, [0, 0, 1.0] + 0.3 * rng.normal(size=3)), tangent)
    normal /= np.linalg.norm(normal)
    place = hanging.positions_at([s])[0] - (rod.radius + _GAP) * normal
    friction = None if frictions is None else rng.choice(frictions)
    return normal, random_obstacle(rng, place, normal, tangent, friction)


def random_scene(rng, how):
    """Return a simulator, its Shape above an obstacle and Poses: down onto it, then across it."""
    while True:
        rod, obstacle, poses = _drawn(rng)
        if distance(obstacle, np.array([pose.position for pose in poses])).min() < 2 * rod.radius:
            continue  # the gripper would be in it
        simulator = DirectSimulator(rod, obstacles=[obstacle], **how)
        shape = simulator.solve(poses[0])
        if shape.converged and not shape.contacts:
            return simulator, shape, poses[1:]


def _drawn(rng):
    stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
    if rng.random() < 0.5:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 * (rng.random() < 0.5)
    rod = Rod(1.0, MASS, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
              natural_curvature=tuple(bent), radius=rng.choice([5e-4, 2e-3, 1e-2]))
    attitude = Rotation.from_euler('zyx', rng.uniform((-3, -0.5, -3), (3, 1.4, 3)))
    start = Pose((0, 0, 0), attitude.as_quat())
    normal, obstacle = _below(rng, rod, start)
    across = rng.normal(size=3)
    across -= (across @ normal) * normal
    across /= np.linalg.norm(across)
    step, turned = np.exp(rng.uniform(np.log(2e-3), np.log(3e-2))), 0.05 * rng.normal(size=3)
    poses = [Pose(-0.015 * k * normal, start.quaternion) for k in range(_PRESSED + 1)]
    for k in range(1, _DRAWN + 1):
        poses.append(Pose(poses[_PRESSED].position + k * step * across,
                          (Rotation.from_rotvec(k * turned) * attitude).as_quat()))
    return rod, obstacle, poses


def law_of_friction(shape, mu):
    """Return what is wrong with a step, or 'converged'."""
    if not shape.converged:
        return f'not converged: {shape.status}'
    for contact in shape.contacts:
        size = np.linalg.norm(contact.friction)
        if not size <= mu * contact.force * (1 + _LAW):
            return f'above the limit: {size / contact.force:.9g} of {mu:.9g}'
        if abs(contact.friction @ contact.normal) > 1e-9 * contact.force:
            return 'not across the normal'
    return 'converged'


def drawn(simulator, shape, poses, name=''):
    """Yield the Outcome of every step through the poses of a scene."""
    obstacle = simulator.obstacles[0]
    for k, pose in enumerate(poses):
        after, seconds = timed(simulator.solve, pose, shape)
        what = law_of_friction(after, obstacle.friction)
        if what != 'converged':
            what += f' ({name}, {type(obstacle).__name__}, step {k})'
        elif not after.contacts:
            what = 'away'
        yield Outcome(what, seconds)
        if after.converged:
            shape = after


def drags(number, seed):
    """Yield the Outcomes of every step of a number of scenes."""
    for index in range(number):
        rng = np.random.default_rng((seed, index))
        yield from drawn(*random_scene(rng, DRAWN_ON[index % 4]), f'scene {index}')


# ---- falls ----------------------------------------------------------------------------------


def random_way(rng):
    """Return Rod, obstacle, step and the Poses of a way over it, the first above it."""
    while True:
        stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
        rod = Rod(1.0, MASS, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
                  natural_curvature=tuple(0.6 * rng.normal(size=2) * (rng.random() < 0.5)),
                  radius=rng.choice([5e-4, 2e-3, 1e-2]))
        attitude = Rotation.from_euler('zyx', rng.uniform((-3, -0.5, -3), (3, 1.0, 3)))
        start = Pose((0, 0, 0), attitude.as_quat())
        normal, obstacle = _below(rng, rod, start, (0.0, 0.2, 0.5))
        step = np.exp(rng.uniform(*np.log(LONG)))
        poses, down = [start], normal
        for _ in range(_FALLEN):
            aside = rng.normal(size=3)
            way = 0.7 * aside / np.linalg.norm(aside) - down
            turn = Rotation.from_rotvec(0.5 * step * rng.normal(size=3))
            poses.append(Pose(poses[-1].position + step * way / np.linalg.norm(way),
                              (turn * Rotation.from_quat(poses[-1].quaternion)).as_quat()))
            down = 0.3 * down
        places = np.concatenate([np.linspace(a.position, b.position, 20) for a, b in
                                 zip(poses, poses[1:], strict=False)])
        if distance(obstacle, places).min() > 2 * rod.radius:  # else the gripper would be in it
            return rod, obstacle, step, poses


def in_parts(one, other, number):
    """Return the Poses on the way from one to another, in steps of a part."""
    turn = Rotation.from_matrix(other.rotation @ one.rotation.T).as_rotvec()
    return [Pose.from_rotation(one.position + part * (other.position - one.position),
                               Rotation.from_rotvec(part * turn).as_matrix() @ one.rotation)
            for part in np.arange(1, number + 1) / number]


def _away(one, other):
    places = np.linspace(0.05, 1, 20)
    return np.linalg.norm(one.positions_at(places) - other.positions_at(places), axis=1).max()


def fallen(rod, obstacle, step, poses, how):
    """Return 'converged', 'away', or what is wrong with a way."""
    simulator = DirectSimulator(rod, obstacles=[obstacle], **how)
    long = short = simulator.solve(poses[0])
    touched = slid = False
    cuts = int(np.ceil(step / _CUT))  # that are made of a long step anyway
    for k, (begin, end) in enumerate(zip(poses, poses[1:], strict=False)):
        before, long = long, simulator.track([end], initial=long)[0]
        shapes = simulator.track(in_parts(begin, end, _PARTS * cuts), initial=short)
        short = shapes[-1]
        if not long.converged or not all(shape.converged for shape in shapes):
            return f'not converged: {"long" if not long.converged else "short"} step {k}'
        touched |= any(bool(shape.contacts) for shape in (long, *shapes))
        if long.jumped or any(shape.jumped for shape in shapes):
            both = long.jumped and any(shape.jumped for shape in shapes)
            return 'jumped' if both else 'jumped in ' + ('long' if long.jumped else 'short') + (
                ' steps only')
        off, left = _away(long, short), 0.0
        if off > _SAME * rod.length:
            quarters = simulator.track(in_parts(begin, end, 4 * cuts), initial=before)
            left = _away(quarters[-1], short) / off
        if _SLID[0] < left < _SLID[1]:
            slid, short = True, long
        elif off > _SAME * rod.length:
            return (f'silent fall: off by {off:.3g} m, {left:.2g} of it in quarters, at step {k} '
                    f'of {step:.3g} m, '
                    f'{type(obstacle).__name__} with friction {obstacle.friction:g}, {how}')
    return 'slid' if slid else 'converged' if touched else 'away'


def falls(number, seed):
    """Yield the Outcomes of a number of ways, each made in long steps and in short ones."""
    for index in range(number):
        way, begun = random_way(np.random.default_rng((seed, index))), process_time()
        yield Outcome(fallen(*way, FALLS_ON[index % 4]), process_time() - begun)


# ---- slow slides ----------------------------------------------------------------------------


def random_slide(seed):
    """Return a simulator, a way and the time (s) of each of its parts, all at random."""
    rng = np.random.default_rng(seed)
    stiffness = 0.3 * 10 ** rng.uniform(-2.5, 0)
    weight = 8 * stiffness * 10 ** rng.uniform(-1, 1)
    rod = Rod(1.0, stiffness, rng.uniform(0.2, 1) * stiffness, weight / 9.81,
              radius=rng.uniform(0.002, 0.01), damping=(0, 10 ** rng.uniform(-3, -1.5)))
    friction = [0.0, 0.0, 0.3][rng.integers(3)]
    obstacles = [_in_the_way(rng, friction) for _ in range(rng.integers(1, 4))]
    mesh = [{}, {'n_elements': 32}, {'n_elements': 32, 'basis': 'local'},
            {'n_elements': 24}][rng.integers(4)]
    way = [Pose.looking_along((0, 0, 0), (1, 0, 0))]
    for _ in range(2):
        place = rng.uniform((-0.2, -0.1, -0.1), (0.2, 0.1, 0.3))
        way.append(Pose.looking_along(place, (1, rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5))))
    dt = [0.5, 2.0, 10.0, 60.0][rng.integers(4)]
    return DirectSimulator(rod, obstacles=obstacles, **mesh), [*way, way[0]], dt


def _in_the_way(rng, friction):
    kind = rng.integers(4)
    place = np.array([rng.uniform(*ends) for ends in ((0.3, 0.9), (-0.15, 0.15), (-0.5, -0.15))])
    if kind == 0:
        return Sphere(place, rng.uniform(0.03, 0.1), friction=friction)
    if kind == 1:
        return Cylinder(place - [0, 1, 0], place + [0, 1, 0], rng.uniform(0.01, 0.08),
                        friction=friction)
    if kind == 2:
        return Box(Pose(place, (0, 0, 0, 1)), rng.uniform(0.05, 0.12, 3), friction=friction)
    return Plane((0, 0, rng.uniform(-0.5, -0.2)), (0, 0, 1), friction=friction)


def slides(number, seed):
    """Yield the Outcomes of a number of motions."""
    for one in range(seed, seed + number):
        simulator, way, dt = random_slide(one)
        motion, seconds = timed(simulator.simulate, way, dt)
        end = '' if motion.status == 'complete' else f': at {motion.times[-1]:.3g} of {3 * dt:g} s'
        yield Outcome(motion.status + end, seconds)
