# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cases of the direct simulation in which a DLO touches, with and without friction."""

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.oracle.shapes import of_shapes, yielding_rod
from benchmarks.scenes import GRAVITY, SCENES
from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    DirectSimulator,
    FarEnd,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.rods import GraspedInside

HOW = {}, {'basis': 'local'}, {'basis': 'local', 'n_elements': 32}, {'n_elements': 32, 'n_terms': 8}
_ROOM = 0.03  # m, between the gripper and what is touched
LOOSE, RUBBING = 10.0, 100.0  # positions in contact, and with friction, see `answers.POSITION`


def stiff_rod(given, **more):
    """Return a Rod of 1 m that its weight bends little enough to be pushed about."""
    stiffness = [given.between(0.05, 2) for _ in range(2)]
    if given.rng.random() < 0.5:
        stiffness[1] = stiffness[0]
    bent = given.rng.normal(size=2) * 0.6 * (given.rng.random() < 0.4)
    return Rod(1.0, 0.05, tuple(stiffness), given.between(0.05, 1), natural_curvature=tuple(bent),
               radius=float(given.rng.choice([5e-4, 2e-3, 1e-2])), **more)


def body(given, kind, place, normal, tangent, friction=0.0):
    """Return an obstacle whose surface is at a place (3,), its normal (3,) there outwards."""
    radius, side = given.between(0.02, 0.3), np.cross(normal, tangent)
    if kind == 0:
        return Plane(place, normal, friction)
    if kind == 1:
        return Sphere(place - radius * normal, radius, friction)
    if kind in (2, 3):
        axis = side + 0.3 * given.rng.normal() * tangent
        axis /= np.linalg.norm(axis)
        middle = place - radius * normal
        one = Capsule if kind == 2 else Cylinder
        return one(middle - 0.5 * axis, middle + 0.5 * axis, radius, friction)
    frame = Rotation.from_matrix(np.column_stack([tangent, side, normal])) * Rotation.from_rotvec(
        0.3 * given.rng.normal(size=3))
    if kind == 4:
        size = np.array([given.rng.uniform(0.05, 0.2), 0.4, 0.1])
        return Box(Pose(place - frame.apply([0, 0, 0.05]), frame.as_quat()), size, friction)
    upright = frame * Rotation.from_euler('y', -90, degrees=True)  # its normal is the box's z
    return Sheet(Pose(place, upright.as_quat()), 0.4, given.rng.uniform(0.1, 0.4), 2e-3, (),
                 friction)


def near(obstacle, place):
    """Return the distance of a place (3,) from an obstacle, m, or less."""
    if isinstance(obstacle, Plane):
        return (place - obstacle.point) @ obstacle.normal
    if isinstance(obstacle, Sphere):
        return np.linalg.norm(place - obstacle.center) - obstacle.radius
    if isinstance(obstacle, Capsule | Cylinder):
        way = obstacle.end - obstacle.start
        part = np.clip((place - obstacle.start) @ way / (way @ way), 0, 1)
        return np.linalg.norm(place - obstacle.start - part * way) - obstacle.radius
    size = (obstacle.size if isinstance(obstacle, Box)
            else (obstacle.thickness, obstacle.width, obstacle.height))
    beyond = np.abs(obstacle.pose.rotation.T @ (place - obstacle.pose.position))
    return np.max(beyond - 0.5 * np.asarray(size))


def scene(given, friction=0.0, number=1, rod=None):
    """Return a rod, obstacles below where it hangs, and poses: down onto them, then across."""
    while True:
        own = stiff_rod(given) if rod is None else rod
        obstacles, poses = _drawn(given, own, friction, number)
        if min(near(one, pose.position) for one in obstacles for pose in poses) > _ROOM:
            return own, obstacles, poses  # the gripper itself is in none


def _drawn(given, rod, friction, number):
    rng = given.rng
    attitude = Rotation.from_euler('zyx', rng.uniform((-3, -0.5, -3), (3, 1.2, 3)))
    start = given.pose((0, 0, 0), attitude.as_quat())
    hanging = DirectSimulator(rod, basis='local').solve(start)
    obstacles, normal = [], None
    for k in range(number):
        s = (rng.uniform(0.35, 1.0) if number == 1 else rng.uniform(0.35, 0.6) + 0.35 * k)
        place = hanging.at(s * rod.length)
        tangent = place.rotation[:, 0]
        up = np.cross(np.cross(tangent, [0, 0, 1.0] + 0.3 * rng.normal(size=3)), tangent)
        up /= np.linalg.norm(up)
        normal = up if normal is None else normal
        surface = place.position - (rod.radius + 5e-3) * up
        obstacles.append(body(given, (given.number + k) % 6, surface, up, tangent, friction))
    across = np.cross(normal, given.direction())
    across *= given.between(0.02, 0.15) / np.linalg.norm(across)
    down = given.way(start, -rng.uniform(0.02, 0.06) * normal, (0, 0, 0), 3)
    return obstacles, [start, *down, *given.way(down[-1], across, 0.2 * rng.normal(size=3), 4)]


def _of(given, rod, obstacles, poses, loose, estimate=True):
    direct = DirectSimulator(rod, obstacles=obstacles, **HOW[given.number // 6 % 4])
    return of_shapes(direct.track(poses), rod, loose,
                     estimate=estimate and given.number % 4 == 0)


def pressed(given):
    """Press a DLO onto an obstacle of every kind, and move on."""
    return _of(given, *scene(given), LOOSE)


def rubbed(given):
    """Draw a DLO over an obstacle with friction."""
    return _of(given, *scene(given, given.between(0.05, 0.8)), RUBBING)


def between_two(given):
    """Move a DLO on two obstacles, some with friction."""
    friction = 0.3 if given.number % 3 == 0 else 0.0
    return _of(given, *scene(given, friction, 2), RUBBING if friction else LOOSE)


def at_a_corner(given):
    """Press a DLO onto the corner or the rim of a sheet, or the corner of a box."""
    rod = stiff_rod(given)
    hole = CutOut(Pose((0.5, 0, -0.15), (0, 0, 0, 1)), radius=0.03)
    turn = Rotation.from_rotvec(given.rng.normal(size=3) * 0.5)
    if given.number % 3 == 0:  # the hole is about the DLO
        one = Sheet.around(hole, 0.3, 0.3)
        start = given.turned((0, 0, -0.15), (0, 0, 0))
    elif given.number % 3 == 1:
        one = Sheet(Pose((0.5, 0.0, -0.35), turn.as_quat()), 0.3, 0.3, 5e-3)
        start = given.turned((0, 0, 0.2), (0, 0, 0))
    else:
        up = Rotation.align_vectors([(0, 0, 1)], [(1, 1, 1)])[0]
        one = Box(Pose((0.5, 0.02, -0.4), (turn * up).as_quat()), (0.3, 0.3, 0.3))
        start = given.turned((0, 0, 0.2), (0, 0, 0))
    way = given.rng.normal(size=3) * 0.02 - (0, 0, 0.1)
    return _of(given, rod, [one], [start, *given.way(start, way, 0.1 * given.direction(), 6)],
               LOOSE)


def set_down(given):
    """Solve once for a DLO that is set down among obstacles, some of which it never touches."""
    rod, obstacles, poses = scene(given)
    far = Plane((0, 0, -3.0), (0, 0, 1)), Sphere((0, 0, 5.0), 0.3)
    direct = DirectSimulator(rod, obstacles=[*far, *obstacles], **HOW[given.number % 4])
    return of_shapes([direct.solve(poses[2 * (given.number % 3)])], rod, LOOSE,
                     estimate=given.number % 3 == 0)


def stepped(given):
    """Solve step by step, each from the shape before, to an accuracy or not."""
    rod, obstacles, poses = scene(given, 0.2 * (given.number % 2))
    how = {'accuracy': 1e-4} if given.number % 3 == 0 else HOW[given.number % 4]
    direct, shapes = DirectSimulator(rod, obstacles=obstacles, **how), [None]
    for pose in poses[:5]:
        shapes.append(direct.solve(pose, shapes[-1]))
    return of_shapes(shapes[1:], rod, RUBBING, estimate=given.number % 3 == 0)


def ordinary(given):
    """Follow the first poses of an ordinary scene of `benchmarks.scenes`."""
    rod, obstacles, poses = [*SCENES.values()][given.number]()
    direct = DirectSimulator(rod, obstacles=obstacles, gravity=GRAVITY, basis='local',
                             n_elements=64)
    shaken = [given.pose(pose.position, pose.quaternion) for pose in poses[:10]]
    return of_shapes(direct.track(shaken), rod, RUBBING)


def idle(given):
    """Follow a motion near obstacles that are in reach and never touched."""
    rod = stiff_rod(given)
    around = [Plane((0, 0, -1.5), (0, 0, 1)), Box(Pose((0.2, 1.6, 0), (0, 0, 0, 1)), (1, 1, 1)),
              Sphere((-1.5, 0, 0), 0.3)][:1 + given.number % 3]
    direct = DirectSimulator(rod, obstacles=around, **HOW[given.number % 4])
    start = given.turned((0, 0, 0), (0, given.rng.uniform(-0.5, 0.5), 0))
    poses = given.way(start, 0.1 * given.direction(), 0.3 * given.direction(), 4)
    return of_shapes(direct.track(poses), rod)


def held_over(given):
    """Lower a DLO that is held at both ends onto an obstacle."""
    rod = stiff_rod(given)
    span, friction = given.rng.uniform(0.6, 0.9), 0.3 * (given.number % 3 == 2)
    start, end = given.turned((0, 0, 0), (0, 0.4, 0)), given.turned((span, 0, 0), (0, -0.4, 0))
    low = DirectSimulator(rod).solve(start, far_end=FarEnd(end)).positions[:, 2].min()
    place = np.array([0.5 * span, 0.0, low - rod.radius - 0.01])
    one = body(given, given.number % 5, place, np.array([0, 0, 1.0]), np.array([1.0, 0, 0]),
               friction)
    direct = DirectSimulator(rod, obstacles=[one], **HOW[given.number % 3])
    down = (*0.01 * given.rng.normal(size=2), -0.06)
    grip = 'pinned' if given.number % 4 == 3 else 'clamped'
    ends = [FarEnd(pose, grip) for pose in (end, *given.way(end, down, (0, 0, 0), 4))]
    shapes = direct.track([start, *given.way(start, down, (0, 0, 0), 4)], far_ends=ends)
    return of_shapes(shapes, rod, RUBBING if friction else 30.0,
                     estimate=given.number % 4 == 0)


def grasped_over(given):
    """Lower a DLO that is grasped inside onto a floor or a bar."""
    rod = stiff_rod(given)
    floor = (Plane((0, 0, -0.12), (0, 0, 1), 0.2 * (given.number % 2)) if given.number % 3 else
             Capsule((0.3, -1, -0.2), (0.3, 1, -0.2), 0.05))
    direct = GraspedInside(rod, given.rng.uniform(0.3, 0.7), obstacles=[floor],
                           **HOW[given.number % 4])
    start = given.turned((0, 0, 0.3), (0, 0, 0))
    shapes = direct.track([start, *given.way(start, (0.02, 0, -0.35), 0.2 * given.direction(), 5)])
    return of_shapes(shapes, rod, RUBBING, estimate=False)


def drawn_over_a_bar(given):
    """Press a DLO that yields onto a bar, and draw it on."""
    rod = yielding_rod(given)
    rod = Rod(**{name: getattr(rod, name) for name in (
        'mass_per_length', 'bending_stiffness', 'torsional_stiffness', 'yield_curvature',
        'yield_torsion', 'section', 'hardening')},
        length=rod.length, radius=rod.radius,
        section_model=rod.section_model) if given.number % 3 != 1 else rod
    start = given.turned((0, 0, 0), (0, 0.1, 0))
    hanging = DirectSimulator(rod, basis='local').solve(start)
    x, _, z = hanging.at(0.5 * rod.length).position
    bar = Capsule((x, -1, z - 0.05), (x, 1, z - 0.05), 0.04, 0.2 * (given.number % 2))
    direct = DirectSimulator(rod, obstacles=[bar], **HOW[given.number % 2 * 2])
    down = given.way(start, (0, 0, -0.08), (0, 0.3, 0), 4)
    poses = [start, *down, *given.way(down[-1], (-0.15, 0.01, 0), (0, 0, 0), 4)]
    poses += given.way(poses[-1], (0, 0, 0.1), (0, -0.5, 0), 3)
    return of_shapes(direct.track(poses), rod, RUBBING, estimate=False)
