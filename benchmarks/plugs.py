# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plugs with a cable that trails to a fixed end: into sockets in MuJoCo, and their wrenches apart.

`python -m benchmarks.plugs [COUNT] [SEED]` plans COUNT insertions into sockets at random places and
carries each out twice, by a compliant hand (500 N/m, 20 N m/rad) in which the plug sits off by a
random error (2 mm and 0.04 rad, root mean square): with the plan's wrenches fed forward, and
without. The socket has 0.25 mm of clearance and rubs with 0.3. At the end the hand pushes on, by
10 N at most. `python -m benchmarks.plugs wrenches [COUNT] [SEED]` compares what the hand has to
give at the plug's front with a shooting solution of Kirchhoff's rod by SciPy, in random holds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from time import process_time
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from dlo_planner import (
    CutOut,
    DirectSimulator,
    FarEnd,
    Infeasible,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
    Sheet,
)
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import displaced
from dlo_planner.tasks import InsertPlug, Plug

ROD = Rod.circular(0.5, 0.006, 2500, 6e7, 0.4)
PLUG = Plug(0.03, 0.006, 0.02)
FAR_END = FarEnd(Pose.looking_along((0, 0, 0), (-1, 0, 0)))  # the cable ends there along -x
DEPTHS = np.linspace(0, 0.015, 7)  # m
CLEARANCE, FRICTION, LIMIT = 0.25e-3, 0.3, 20.0  # m, 1, N
IN = 0.001         # m: a plug that is less short of the last depth is in
_WALL = 0.02       # m, thickness of the socket
_SLOWER = 5.0      # times as slow as the plan's times: 20 mm/s
_LOOKS = 40        # poses that the hand is commanded to
_PUSH, _PUSHES, _EACH = 10.0, 20, 0.05  # N, how often it is raised, and s each
_ERROR = np.repeat([0.04, 0.002], 3) / np.sqrt(3)  # rad, m: deviations of each component
_GRAVITY = np.array([0.0, 0.0, -9.81])


def socket_around(socket: Pose) -> Sheet:
    """Return the wall with the hole that a socket is."""
    middle = Pose(socket.position + 0.5 * _WALL * socket.rotation[:, 0], socket.quaternion)
    hole = CutOut(middle, radius=PLUG.radius + CLEARANCE)
    return Sheet(middle, 0.08, 0.08, _WALL, (hole,), FRICTION, name='socket')


def settings(count: int, seed: int) -> Iterator[tuple[InsertPlug, Pose]]:
    """Yield random insertions, and by how much the plug sits off in the hand."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        place = np.array([0.2, 0.2, 0.05]) + rng.uniform(-0.04, 0.04, 3)
        axis = np.array([0.0, -1.0, 0.0]) + rng.uniform(-0.3, 0.3, 3)
        error = displaced(Pose.identity(), _ERROR * rng.normal(size=6))
        yield InsertPlug(Pose.looking_along(place, axis), PLUG, DEPTHS, far_end=FAR_END), error


def planned(task: InsertPlug) -> Plan:
    """Return the Plan of an insertion, past the socket's wall."""
    simulator = DirectSimulator(ROD, n_elements=64, basis='local',
                                obstacles=[socket_around(task.socket)])
    return InverseSimulator(simulator).plan(task)


def inserted(task: InsertPlug, plan: Plan, error: Pose, feed: bool, cells: int = 24,
             slower: float = _SLOWER) -> tuple[float, float, Any]:
    """Return how deep the plug comes in MuJoCo (m), how far off it is at the mouth, what is felt.

    Off across the axis, of where it would be in a hand that gives way to nothing.
    """
    from dlo_planner.cell.plug import HeldPlug  # noqa: PLC0415  (an extra)

    cell = HeldPlug(ROD, PLUG, plan.grippers[0], [socket_around(task.socket)], far_end=FAR_END,
                    error=error, limit=LIMIT, cells=cells)
    axis, along = task.socket.rotation[:, 0], plan.times / plan.times[-1]

    def wrench(share: float) -> Floats | None:
        return np.array([np.interp(share, along, column) for column in plan.plug_wrenches.T]) if (
            feed) else None

    mouth = along[plan.stages[-1].first]
    shares = np.unique(np.append(np.linspace(0, 1, _LOOKS), mouth))
    off = np.nan
    for before, share in zip(shares, shares[1:], strict=False):
        position, rotation = plan.paths['gripper'].at(share * plan.times[-1])
        pose = Pose.from_rotation(position[0], rotation[0])
        cell.led(pose, slower * (share - before) * plan.times[-1], wrench(share))
        if share == mouth:
            miss = cell.front.position - PLUG.front(pose.compose(error)).position
            off = float(np.linalg.norm(miss - (miss @ axis) * axis))
    for k in range(1, _PUSHES + 1):
        if depth_of(task, cell.front) > DEPTHS[-1] - IN:
            break
        cell.led(plan.grippers[-1], _EACH, wrench(1.0), k / _PUSHES * _PUSH * axis)
    return depth_of(task, cell.front), off, cell.felt


def depth_of(task: InsertPlug, front: Pose) -> float:
    """Return how deep a plug's front is in the socket, m."""
    return float((front.position - task.socket.position) @ task.socket.rotation[:, 0])


def shot(gripper: Pose, far_end: Pose, guess: Floats) -> Floats | None:
    """Return (6,) what the gripper exerts on the cable by shooting, or None if not found.

    Kirchhoff's equations of an inextensible rod along s: x' = t, the frame turns by its strains
    K^-1 R^T m, m' = -t x n, n' = w up, of the force n and moment m that what is beyond exerts.
    """
    stiffness, weight = ROD.stiffness, -ROD.mass_per_length * _GRAVITY

    def ahead(wrench: Floats) -> Floats:
        def slopes(s: float, y: Floats) -> Floats:
            x, yq, z, w = y[:4] / np.sqrt(y[:4] @ y[:4])
            rotation = np.array([
                [1 - 2 * (yq * yq + z * z), 2 * (x * yq - z * w), 2 * (x * z + yq * w)],
                [2 * (x * yq + z * w), 1 - 2 * (x * x + z * z), 2 * (yq * z - x * w)],
                [2 * (x * z - yq * w), 2 * (yq * z + x * w), 1 - 2 * (x * x + yq * yq)]])
            tangent, force = rotation[:, 0], weight * s - wrench[:3]
            ox, oy, oz = rotation @ (rotation.T @ y[7:] / stiffness)
            turn = 0.5 * np.array([w * ox + oy * z - oz * yq, w * oy + oz * x - ox * z,
                                   w * oz + ox * yq - oy * x, -ox * x - oy * yq - oz * z])
            across = np.array([tangent[1] * force[2] - tangent[2] * force[1],
                               tangent[2] * force[0] - tangent[0] * force[2],
                               tangent[0] * force[1] - tangent[1] * force[0]])
            return np.concatenate([turn, tangent, -across])

        begin = np.concatenate([gripper.quaternion, gripper.position, -wrench[3:]])
        end = solve_ivp(slopes, (0, ROD.length), begin, method='DOP853', rtol=1e-9,
                        atol=1e-11).y[:, -1]
        turned = Rotation.from_quat(end[:4]) * Rotation.from_matrix(far_end.rotation).inv()
        return np.concatenate([turned.as_rotvec(), (end[4:7] - far_end.position) / 0.1])

    found = root(ahead, guess, tol=1e-9)
    return np.asarray(found.x) if np.abs(ahead(found.x)).max() < 1e-7 else None


def front_wrench(gripper: Pose, on_cable: Floats) -> Floats:
    """Return (6,) what a hand has to give at the plug's front, by the balance of a rigid body."""
    front = gripper.position - PLUG.length * gripper.rotation[:, 0]
    lift = -PLUG.mass * _GRAVITY
    middle = gripper.position - 0.5 * PLUG.length * gripper.rotation[:, 0]
    moment = (on_cable[3:] + np.cross(gripper.position - front, on_cable[:3])
              + np.cross(middle - front, lift))
    return np.concatenate([on_cable[:3] + lift, moment])


def wrenches(count: int = 100, seed: int = 3) -> list[float]:
    """Print how far both are apart in random holds; return it, as a part of force and moment."""
    found, missed = list[float](), 0
    for task, _ in settings(count, seed):
        shape = DirectSimulator(ROD, n_elements=128, basis='local').solve(
            task.gripper_at(0.0), far_end=FAR_END)
        own = PLUG.wrench(shape.gripper, shape.gripper_wrench, _GRAVITY)
        # from a guess that is off by 1 %
        by_shooting = shot(shape.gripper, FAR_END.pose, 1.01 * shape.gripper_wrench)
        if by_shooting is None or not shape.converged:
            missed += 1
            continue
        there = front_wrench(shape.gripper, by_shooting)
        found.append(max(float(np.linalg.norm((own - there)[part]) / np.linalg.norm(there[part]))
                         for part in (slice(3), slice(3, 6))))
    print(f'{count} holds: {len(found)} found by shooting, {missed} not; apart by '
          f'{np.median(found):.1e} median, {max(found):.1e} at most of force and moment')
    return found


def main(count: int = 40, seed: int = 5) -> None:
    """Print each insertion, and a summary."""
    came: dict[bool, list[tuple[bool, float, Any]]] = {True: [], False: []}
    refused = 0
    for k, (task, error) in enumerate(settings(count, seed)):
        begun = process_time()
        try:
            plan = planned(task)
        except Infeasible as why:
            refused += 1
            print(f'{k:2d} refused: {why}', flush=True)
            continue
        turned = Rotation.from_matrix(error.rotation).magnitude()
        print(f'{k:2d} planned in {process_time() - begun:.2f} s, sits off by '
              f'{np.linalg.norm(error.position) * 1e3:.1f} mm, {turned:.3f} rad', end='',
              flush=True)
        for feed, runs in came.items():
            depth, off, felt = inserted(task, plan, error, feed)
            inside = depth > DEPTHS[-1] - IN
            runs.append((inside, off, felt))
            print(f'; {"fed forward" if feed else "without"}: {"in" if inside else "NOT IN"} '
                  f'{depth * 1e3:.1f} mm, off {off * 1e3:.2f} mm, {felt.largest:.1f} N, above '
                  f'{felt.above:.3f} s', end='', flush=True)
        print(flush=True)
    for feed, runs in came.items():
        print(f'{"fed forward" if feed else "without"}: {sum(one for one, *_ in runs)} of '
              f'{len(runs)} in; above {LIMIT:g} N for {max(felt.above for *_, felt in runs):.3f} s '
              f'at most; pulled off by {np.median([off for _, off, _ in runs]) * 1e3:.2f} mm '
              f'median, {max(off for _, off, _ in runs) * 1e3:.2f} mm at most at the mouth')
    print(f'{refused} refused')


if __name__ == '__main__':
    if sys.argv[1:2] == ['wrenches']:
        wrenches(*map(int, sys.argv[2:]))
    else:
        main(*map(int, sys.argv[1:]))
