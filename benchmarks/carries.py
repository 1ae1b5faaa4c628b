# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random carries of a cable between two grips, past a box and a post above a floor, judged apart.

`python -m benchmarks.carries [COUNT] [SEED] [IN_ENGINE]` plans each by `Carry`, and judges the way
of both grips by itself: followed in small steps, distances by formulas of its own from points of
the DLO, forces and moments at both grips, and no node that moves more in a step than what holds
the DLO makes it. For a carry that is refused it looks whether a way over the obstacles exists:
lifted, across, lowered, at any height, in such small steps. The first IN_ENGINE plans with stops
are moved through by a chain of 100 pieces in MuJoCo, at their own times (extra `cell`): forces of
contacts, and how far it is off when it has come to rest.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from time import process_time
from typing import NamedTuple

import numpy as np

from dlo_planner import (
    Box,
    Capsule,
    DirectSimulator,
    FarEnd,
    Infeasible,
    InverseSimulator,
    Plan,
    Plane,
    Pose,
    Rod,
)
from dlo_planner.direct.grips import between
from dlo_planner.direct.shape import Shape
from dlo_planner.tasks import Carry

ROD = Rod.circular(1.0, 0.008, 1500, 5e7, 0.4, max_bend_curvature=1 / 0.04)
MAX_FORCE, MAX_MOMENT, CLEARANCE = 1.5, 0.3, 0.003  # N, N m, m
_STEP, _TURN = 2.5e-3, 5e-3  # m and rad of a grip between two shapes that are judged
_POINTS = 401      # of the DLO
_HEIGHTS = np.arange(0.0, 0.85, 0.05)  # m, of the ways over that are tried where one is refused
# m: a node that leaps; nodes go at most about three times as far as the grips in a step
_LEAP = 8 * _STEP
_PIECES, _REST = 100, 2.0  # of the chain in MuJoCo; s that it is given to come to rest
_NEAR = 0.06       # m along the DLO: pieces that are nearer are neighbors


class Setting(NamedTuple):
    """Both grips before and after, and what stands around."""

    begin: tuple[Pose, Pose]
    end: tuple[Pose, Pose]
    box: Box
    post: Capsule
    floor: Plane

    @property
    def obstacles(self) -> tuple[Box, Capsule, Plane]:
        """All three."""
        return self.box, self.post, self.floor


def settings(count: int, seed: int) -> Iterator[Setting]:
    """Yield random ones."""
    rng, along = np.random.default_rng(seed), Pose.looking_along

    def grips() -> tuple[Pose, Pose]:
        middle = np.array([rng.uniform(-0.3, 0.3), rng.choice([-1, 1]) * rng.uniform(0.3, 0.45),
                           rng.uniform(0.45, 0.65)])
        angle, width = rng.uniform(-0.5, 0.5), rng.uniform(0.45, 0.85)
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        tilts = rng.uniform(-0.6, 0.6, 2)
        return (along(middle - way * width / 2, way + [0, 0, tilts[0]]),
                along(middle + way * width / 2, way + [0, 0, tilts[1]]))

    for _ in range(count):
        begin, end = grips(), grips()
        height = rng.uniform(0.3, 0.6)
        box = Box(along((rng.uniform(-0.1, 0.1), 0, height / 2), (1, rng.uniform(-0.3, 0.3), 0)),
                  (rng.uniform(0.15, 0.4), 0.12, height), name='box')
        x = rng.uniform(-0.4, 0.4)
        yield Setting(begin, end, box, Capsule((x, 0.1, 0), (x, 0.1, 0.45), 0.02, name='post'),
                      Plane((0, 0, 0), (0, 0, 1), name='floor'))


def room(setting: Setting, shape: Shape) -> float:
    """Return the distance of the DLO's surface from all that stands around, m: from its points."""
    points = shape.positions_at(np.linspace(0, ROD.length, _POINTS))
    box, post = setting.box, setting.post
    inside = (points - box.pose.position) @ box.pose.rotation
    beyond = np.abs(inside) - 0.5 * np.asarray(box.size)
    from_box = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
    a, b = np.asarray(post.start), np.asarray(post.end)
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    from_post = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) - post.radius
    return float(min(from_box.min(), from_post.min(), points[:, 2].min()) - 0.004)


def apart_from_itself(shape: Shape) -> float:
    """Return the least distance of the DLO's axis from itself, m; neighbors do not count."""
    s = np.linspace(0, ROD.length, 101)
    points = shape.positions_at(s)
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    return float(away[np.abs(s[:, None] - s[None]) > _NEAR].min())


class Judged(NamedTuple):
    """What was found on a way."""

    room: float     # m, the least
    leap: float     # m, the farthest that a node moves in a step
    force: float    # N, the largest at a grip
    moment: float   # N m
    bend: float     # 1/m, what is left of the largest curvature
    itself: float   # m, the least distance from itself
    followed: bool  # whether each shape was found
    last: Shape

    @property
    def kept(self) -> bool:
        """Whether all demands are."""
        return (self.followed and self.room >= CLEARANCE - 1e-4 and self.leap < _LEAP
                and self.force <= MAX_FORCE * (1 + 1e-3) and self.bend >= 0
                and self.moment <= MAX_MOMENT * (1 + 1e-3) and self.itself > 0.008)


def judged(setting: Setting, ways: tuple[list[Pose], list[Pose]]) -> Judged:
    """Return what a DLO comes to whose grips go through poses, naturally begun."""
    simulator = DirectSimulator(ROD, n_elements=64, basis='local')
    shape = simulator.solve(ways[0][0], far_end=FarEnd(ways[1][0]))
    shapes, followed = [shape], shape.converged
    for gripper, end in zip(ways[0][1:], ways[1][1:], strict=True):
        if not followed:
            break
        shape = simulator.solve(gripper, shape, far_end=FarEnd(end))
        followed = shape.converged and not shape.jumped
        shapes.append(shape)
    wrenches = [wrench for one in shapes for wrench in (one.gripper_wrench, one.far_wrench)]
    moves = [np.linalg.norm(after.positions - before.positions, axis=1).max()
             for before, after in zip(shapes, shapes[1:], strict=False)]
    bend = max(float(np.hypot(*one.element_strains[:, 1:].T).max()) for one in shapes)
    return Judged(min(room(setting, one) for one in shapes), float(max(moves, default=0.0)),
                  max(float(np.linalg.norm(one[:3])) for one in wrenches),
                  max(float(np.linalg.norm(one[3:])) for one in wrenches),
                  1 / 0.04 - bend, min(map(apart_from_itself, shapes[::4])), followed, shapes[-1])


def closely(plan: Plan) -> tuple[list[Pose], list[Pose]]:
    """Return the poses of both grips on a plan's way, in small steps."""
    gripper, end = plan.paths['gripper'], plan.paths['far_end']
    u = np.linspace(*plan.times[[0, -1]], 50)
    while True:
        ways = [path.at(u) for path in (gripper, end)]
        steps = np.max([np.linalg.norm(np.diff(places, axis=0), axis=1)
                        for places, _ in ways], axis=0)
        turns = np.max([np.arccos(np.clip((np.einsum('nij,nij->n', turns[1:], turns[:-1]) - 1) / 2,
                                          -1, 1)) for _, turns in ways], axis=0)
        far = (steps > _STEP) | (turns > _TURN)
        if not far.any():
            return tuple([Pose.from_rotation(*frame) for frame in zip(*way, strict=True)]
                         for way in ways)  # type: ignore[return-value]
        u = np.sort(np.append(u, 0.5 * (u[1:] + u[:-1])[far]))


def over(setting: Setting, height: float) -> tuple[list[Pose], list[Pose]]:
    """Return the poses of both grips on the way over at a height, m, in small steps."""
    def lifted(poses: tuple[Pose, Pose]) -> tuple[Pose, ...]:
        return tuple(Pose(one.position + [0, 0, height], one.quaternion) for one in poses)

    corners = [setting.begin, lifted(setting.begin), lifted(setting.end), setting.end]
    ways: tuple[list[Pose], list[Pose]] = [setting.begin[0]], [setting.begin[1]]
    for one, other in zip(corners, corners[1:], strict=False):
        parts = max(int(np.ceil(max(
            np.linalg.norm(b.position - a.position) / _STEP,
            np.arccos(np.clip((np.trace(a.rotation.T @ b.rotation) - 1) / 2, -1, 1)) / _TURN)))
            for a, b in zip(one, other, strict=True))
        for way, a, b in zip(ways, one, other, strict=True):
            way += [between(a, b, k / parts) for k in range(1, parts + 1)]
    return ways


def planned(setting: Setting) -> tuple[Plan | None, str, float]:
    """Return the Plan of a carry, or None and why; and the seconds of CPU."""
    simulator = DirectSimulator(ROD, n_elements=48, basis='local', obstacles=setting.obstacles)
    (here, end), (there, end_there) = setting.begin, setting.end
    task = Carry(there, end_there, far_end=FarEnd(end), max_force=MAX_FORCE,
                 max_moment=MAX_MOMENT, clearance=CLEARANCE)
    begun = process_time()
    try:
        plan = InverseSimulator(simulator).plan(task, start=here)
    except Infeasible as error:
        return None, str(error), process_time() - begun
    return plan, '', process_time() - begun


def in_engine(setting: Setting, plan: Plan) -> str:
    """Return in words what becomes of a plan in MuJoCo."""
    from dlo_planner.cell.plant import Plant  # noqa: PLC0415  (an extra)

    plant = Plant(ROD, setting.begin[0], setting.obstacles, cells=_PIECES, damping=0.05,
                  far_end=FarEnd(setting.begin[1]))
    s, last = np.linspace(0, ROD.length, 101), plan.shapes[-1]
    begun = np.abs(plant.points(s) - plan.shapes[0].positions_at(s)).max()
    u = np.linspace(*plan.times[[0, -1]], max(40, int(10 * plan.times[-1])))
    ways = [[Pose.from_rotation(*frame) for frame in zip(*path.at(u), strict=True)]
            for path in (plan.paths['gripper'], plan.paths['far_end'])]
    fastest, before = 0.0, plant.points(s)
    for gripper, end in zip(ways[0][1:], ways[1][1:], strict=True):
        plant.move(gripper, u[1] - u[0], end)
        after = plant.points(s)
        fastest = max(fastest, np.linalg.norm(after - before, axis=1).max() / (u[1] - u[0]))
        before = after
    plant.move(ways[0][-1], _REST)
    off = np.abs(plant.points(s) - last.positions_at(s)).max()
    return (f'   MuJoCo: off by {begun:.4f} m at first, contacts {plant.largest_forces.max():.3g} '
            f'N, fastest {fastest:.2f} m/s, off by {off:.4f} m after {_REST:g} s at the goal')


def main(count: int = 40, seed: int = 7, engine: int = 0) -> None:
    """Print each carry, and a summary."""
    kept, refused, missed, seconds = 0, 0, 0, []
    for k, setting in enumerate(settings(count, seed)):
        plan, why, took = planned(setting)
        seconds.append(took)
        if plan is None:
            there = next((height for height in _HEIGHTS
                          if judged(setting, over(setting, height)).kept), None)
            refused, missed = refused + 1, missed + (there is not None)
            found = '' if there is None else f' BUT a way over at {there:.2f} m is free'
            print(f'{k:2d} {took:5.2f} s refused: {why[:110]}{found}', flush=True)
            continue
        own = judged(setting, closely(plan))
        goal = plan.shapes[-1]
        off = np.abs(own.last.positions_at(goal.s) - goal.positions).max()
        good = own.kept and off < 1e-3
        kept += good
        print(f'{k:2d} {took:5.2f} s {"kept" if good else "BROKEN"}: {len(plan):2d} waypoints, '
              f'{len(plan.stops)} stops, room {own.room:.4f} m (plan {plan.clearance.min():.4f}), '
              f'step {own.leap:.4f} m, {own.force:.2f} N (plan {plan.largest_force.max():.2f}), '
              f'{own.moment:.3f} N m (plan {plan.largest_moment.max():.3f}), end off {off:.1e} m',
              flush=True)
        if engine and plan.stops:
            engine -= 1
            print(in_engine(setting, plan), flush=True)
    print(f'{count} carries: {count - refused} planned, {kept} of them kept everything; {refused} '
          f'refused, {missed} of them with a way over; CPU {np.median(seconds):.2f} s median, '
          f'{max(seconds):.2f} s at most')


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
