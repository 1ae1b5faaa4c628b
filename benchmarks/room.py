# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans of threading with the most room, judged by a solver of its own.

The Kirchhoff equations of a hanging rod are shot through segments (Runge-Kutta's fourth-order
method, Newton's iteration swept from the free end, Riccati's way), so that the same sweep has
Jacobi's condition: an equilibrium is a minimum if the part beyond no segment is turned without a
moment. Distances from the sheet are of dense samples. Of the package only a rod's numbers are
used, and a plan's shapes as first guesses.

    python -m benchmarks.room wire 200 1     what part of samples of the measured wire pass
    python -m benchmarks.room soft 200 1     random soft DLOs: how many get a plan, is any wrong
    python -m benchmarks.room kinds 20 1     thick sheets, slots, plugs, tapered and plastic DLOs
    python -m benchmarks.room stiff 100 1    stiff DLOs: the same plans as along the normal
    python -m benchmarks.room advice 40 1    refusals: do the levers that are named hold
    python -m benchmarks.room bores 40 1     bores: how many soft DLOs go in obliquely
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from benchmarks.gaps import distance
from dlo_planner import (
    CutOut,
    DirectSimulator,
    DloPlannerError,
    Infeasible,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
    Sheet,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.inverse.reachable import reachable_shapes
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.path import GripperPath

SEGMENTS, STEPS = 40, 8  # 320 steps: at w L^3/EI = 1000 a tenth of the shortest wave
FINER = 8                # points of a curve between two steps
ROUNDS = 40              # of Newton's iteration
GRAVITY = (0.0, 0.0, -9.80665)
WIRE = Rod(0.2, 0.0174, 1.22e-4, 1.0e-4, radius=1.5e-3)  # as measured
GOALS = {10: 0.85, 0: 0.95, -10: 0.98, -20: 0.98}
PIECES = 3, 12, 48       # of the way between two waypoints; more where few lose the shape
SAME = 2e-3              # of the length, between a planned shape and the own one
own = njit(cache=False, error_model='numpy', nogil=True)


# ------------------------------------------------------------------------------------------------
# The rod. Lengths are of its own, moments of its bending stiffness per length.


@own
def _slope(y, stiffness, natural, force, out):
    """Put the derivative of y (10,): place, quaternion (x, y, z, w), moment in the world."""
    x, yy, z, w = y[3], y[4], y[5], y[6]
    r00, r01, r02 = 1 - 2 * (yy * yy + z * z), 2 * (x * yy - z * w), 2 * (x * z + yy * w)
    r10, r11, r12 = 2 * (x * yy + z * w), 1 - 2 * (x * x + z * z), 2 * (yy * z - x * w)
    r20, r21, r22 = 2 * (x * z - yy * w), 2 * (yy * z + x * w), 1 - 2 * (x * x + yy * yy)
    a = (r00 * y[7] + r10 * y[8] + r20 * y[9]) / stiffness[0] + natural[0]
    b = (r01 * y[7] + r11 * y[8] + r21 * y[9]) / stiffness[1] + natural[1]
    c = (r02 * y[7] + r12 * y[8] + r22 * y[9]) / stiffness[2] + natural[2]
    out[0], out[1], out[2] = r00, r10, r20
    out[3] = 0.5 * (w * a + yy * c - z * b)
    out[4] = 0.5 * (w * b + z * a - x * c)
    out[5] = 0.5 * (w * c + x * b - yy * a)
    out[6] = -0.5 * (x * a + yy * b + z * c)
    out[7] = -(r10 * force[2] - r20 * force[1])
    out[8] = -(r20 * force[0] - r00 * force[2])
    out[9] = -(r00 * force[1] - r10 * force[0])


@own
def _through(y, first, steps, h, stiffness, natural, force):
    """Take y through some steps; the rod's numbers are known at every half step."""
    k1, k2, k3, k4 = np.empty(10), np.empty(10), np.empty(10), np.empty(10)
    for j in range(2 * first, 2 * (first + steps), 2):
        _slope(y, stiffness[j], natural[j], force[j], k1)
        _slope(y + 0.5 * h * k1, stiffness[j + 1], natural[j + 1], force[j + 1], k2)
        _slope(y + 0.5 * h * k2, stiffness[j + 1], natural[j + 1], force[j + 1], k3)
        _slope(y + h * k3, stiffness[j + 2], natural[j + 2], force[j + 2], k4)
        y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    y[3:7] /= np.sqrt((y[3:7]**2).sum())


@own
def _turned(q, v):
    """Turn a quaternion by a rotation vector in the world."""
    size = np.sqrt((v**2).sum())
    f = 0.5 if size < 1e-12 else np.sin(0.5 * size) / size
    a, b, c, w = f * v[0], f * v[1], f * v[2], np.cos(0.5 * size)
    x, y, z, u = q[0], q[1], q[2], q[3]
    q[0] = w * x + a * u + b * z - c * y
    q[1] = w * y + b * u + c * x - a * z
    q[2] = w * z + c * u + a * y - b * x
    q[3] = w * u - a * x - b * y - c * z


@own
def _between(p, q):
    """Return the rotation vector in the world from quaternion q to p."""
    x, y, z, u = -q[0], -q[1], -q[2], q[3]
    a, b, c, w = p[0], p[1], p[2], p[3]
    v = np.array([w * x + a * u + b * z - c * y, w * y + b * u + c * x - a * z,
                  w * z + c * u + a * y - b * x])
    cosine, sine = w * u - a * x - b * y - c * z, np.sqrt((v**2).sum())
    if cosine < 0:
        v, cosine = -v, -cosine
    return v * (2.0 if sine < 1e-12 else 2 * np.arctan2(sine, cosine) / sine)


@own
def _shot(nodes, stiffness, natural, force):
    """Bring nodes (M + 1, 7), quaternions and moments, to equilibrium, the first one clamped.

    Return whether it is one, and whether it is a minimum.
    """
    count = nodes.shape[0] - 1
    steps = (stiffness.shape[0] - 1) // (2 * count)
    h, tiny = 1.0 / (count * steps), 1e-6
    answers = np.empty((count, 6, 6))
    rests = np.empty((count, 6))
    s, c = np.zeros((count + 1, 3, 3)), np.zeros((count + 1, 3))
    nodes[count, 4:] = 0.0
    y, other = np.zeros(10), np.empty(10)
    for _ in range(ROUNDS):
        for k in range(count):
            y[3:] = nodes[k]
            _through(y, k * steps, steps, h, stiffness, natural, force)
            rests[k, :3] = _between(y[3:7], nodes[k + 1, :4])
            rests[k, 3:] = y[7:] - nodes[k + 1, 4:]
            for i in range(6):
                other[:3] = 0.0
                other[3:] = nodes[k]
                if i < 3:
                    turn = np.zeros(3)
                    turn[i] = tiny
                    _turned(other[3:7], turn)
                else:
                    other[4 + i] += tiny  # moments stand at 7, 8, 9
                _through(other, k * steps, steps, h, stiffness, natural, force)
                answers[k, :3, i] = _between(other[3:7], y[3:7]) / tiny
                answers[k, 3:, i] = (other[7:] - y[7:]) / tiny
        minimum = True
        for k in range(count - 1, -1, -1):
            a = answers[k]
            turns, moments = a[:3].copy(), a[3:]
            left = moments - s[k + 1] @ turns
            held = left[:, 3:].copy()
            # two eigenvalues change their signs at once where a shape is symmetric
            minimum = minimum and np.linalg.eigvals(held.astype(np.complex128)).real.min() > 0
            s[k] = -np.linalg.solve(held, left[:, :3].copy())
            c[k] = -np.linalg.solve(held, rests[k, 3:] - s[k + 1] @ rests[k, :3] - c[k + 1])
        changes = np.zeros((count + 1, 6))
        changes[0, 3:] = c[0]
        for k in range(count):
            changes[k + 1] = answers[k] @ changes[k] + rests[k]
            changes[k + 1, 3:] = s[k + 1] @ changes[k + 1, :3] + c[k + 1]
        most = np.abs(changes[:, :3]).max()
        if not most < 1e6:
            return False, False
        part = min(1.0, 0.5 / most) if most > 0 else 1.0
        for k in range(count + 1):
            _turned(nodes[k, :4], part * changes[k, :3])
            nodes[k, 4:] += part * changes[k, 3:]
        if most < 1e-8:
            return True, minimum
    return False, False


@own
def _curve(nodes, stiffness, natural, force):
    """Return places and tangents (n + 1, 3) at all steps, from the origin, of shot nodes."""
    count, n = nodes.shape[0] - 1, (stiffness.shape[0] - 1) // 2
    steps = n // count
    places, tangents = np.zeros((n + 1, 3)), np.empty((n + 1, 3))
    y, rate = np.zeros(10), np.empty(10)
    for j in range(n + 1):
        if j % steps == 0:
            y[3:] = nodes[j // steps]
        places[j] = y[:3]
        _slope(y, stiffness[2 * j], natural[2 * j], force[2 * j], rate)
        tangents[j] = rate[:3]
        if j < n:
            _through(y, j, 1, 1.0 / n, stiffness, natural, force)
    return places, tangents


@dataclass(frozen=True)
class Curve:
    """An own solution: quaternions and moments at segments, and the curve at all steps, m."""

    nodes: Floats     # (M + 1, 7)
    places: Floats    # (n + 1, 3) m
    tangents: Floats  # (n + 1, 3)
    minimum: bool

    def dense(self) -> Floats:
        """Return many points of it: cubics between the steps."""
        h = np.linalg.norm(np.diff(self.places, axis=0), axis=1).mean()
        t = (np.arange(FINER) / FINER)[:, None, None]
        a, b = self.places[:-1], self.places[1:]
        u, v = h * self.tangents[:-1], h * self.tangents[1:]
        points = ((1 + 2 * t) * (1 - t)**2 * a + t * (1 - t)**2 * u + t**2 * (3 - 2 * t) * b
                  + t**2 * (t - 1) * v)
        return np.vstack([points.transpose(1, 0, 2).reshape(-1, 3), self.places[-1:]])

    def at(self, part: float) -> tuple[Floats, Floats]:
        """Return place and tangent at a part of the length."""
        x = np.linspace(0, 1, len(self.places))
        return (np.array([np.interp(part, x, column) for column in self.places.T]),
                np.array([np.interp(part, x, column) for column in self.tangents.T]))


class OwnRod:
    """A rod's numbers at every half step; `stiffer`, `heavier`: factors, `bent`: 1/m more."""

    def __init__(self, rod: Rod, gravity: Any = GRAVITY, stiffer: float = 1.0,
                 heavier: float = 1.0, bent: tuple[float, float] = (0.0, 0.0)) -> None:
        self.length = rod.length
        self.s = np.linspace(0, rod.length, 2 * SEGMENTS * STEPS + 1)
        values = np.array([_numbers(rod, s) for s in self.s])
        self.moment = float(values[0, 1] / rod.length)  # N m
        self.stiffness = values[:, :3] / values[0, 1] * np.array([1.0, stiffer, stiffer])
        self.natural = (rod.natural_strains(self.s) + np.array([0.0, *bent])) * rod.length
        # Simpson's rule on the quarters of a step is not needed: masses vary slowly
        between = 0.5 * np.diff(self.s) * (values[1:, 3] + values[:-1, 3])
        beyond = np.append(np.cumsum(between[::-1])[::-1], 0.0) + rod.tip_mass
        self.force = (np.outer(beyond, gravity) * heavier * rod.length / self.moment)

    def guess(self, shape: Shape, natural: Any) -> Floats:
        """Return nodes (M + 1, 7) as a Shape has them."""
        some = np.linspace(0, self.s.size - 1, SEGMENTS + 1).astype(int)
        turns = [shape.frame_at(s)[0] for s in self.s[some].tolist()]
        strains = np.array([np.interp(self.s[some], shape.s, column)
                            for column in shape.strains.T]).T * self.length
        moments = np.einsum('kij,kj->ki', turns, (strains - natural[some])
                            * self.stiffness[some])
        return np.hstack([Rotation.from_matrix(np.array(turns)).as_quat(), moments])

    def solve(self, position: Floats, quaternion: Floats, nodes: Floats) -> Curve | None:
        """Return the equilibrium that nodes (M + 1, 7) lead to, or None."""
        nodes = nodes.copy()
        nodes[0, :4] = quaternion
        done, minimum = _shot(nodes, self.stiffness, self.natural, self.force)
        if not done:
            return None
        places, tangents = _curve(nodes, self.stiffness, self.natural, self.force)
        return Curve(nodes, position + self.length * places, tangents, minimum)


def _numbers(rod: Rod, s: float) -> tuple[float, ...]:
    """Return torsional and both bending stiffnesses (N m^2) and mass per length (kg/m) at s."""
    def there(value):
        return value(s) if callable(value) else value

    bending = there(rod.bending_stiffness)
    two = bending if isinstance(bending, tuple) else (bending, bending)
    return (there(rod.torsional_stiffness), *map(there, two), there(rod.mass_per_length))


# ------------------------------------------------------------------------------------------------
# The hole.


def room(points: Floats, cutout: CutOut, radius: Any, sheet: Sheet | None = None) -> float:
    """Return the distance (m) of a DLO, points (n, 3) of its axis, from the sheet of a hole.

    -inf: it crosses the plane outside the hole. `radius` (m) is a number or (n,).
    """
    local = (points - cutout.center) @ cutout.pose.rotation
    if cutout.radius is not None:
        inside = cutout.radius - np.hypot(local[:, 1], local[:, 2])
    else:
        inside = (np.array([cutout.width, cutout.height]) / 2 - np.abs(local[:, 1:])).min(axis=1)
    crossed = np.flatnonzero(local[1:, 0] * local[:-1, 0] <= 0)
    if (np.maximum(inside[crossed], inside[crossed + 1]) < 0).any():
        return -np.inf
    gaps = (np.hypot(np.maximum(inside, 0), local[:, 0]) if sheet is None
            else distance(sheet, points))
    return float((gaps - radius).min())


# ------------------------------------------------------------------------------------------------
# Plans.


def normal(elevation: float, heading: float = 0.0) -> Floats:
    """Return a unit vector (3,); angles in degrees."""
    up, around = np.deg2rad([elevation, heading])
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


@dataclass(frozen=True)
class Case:
    """A DLO and a hole; `sheet`: the one around it, if it is thick."""

    rod: Rod
    cutout: CutOut
    sheet: Sheet | None = None

    @property
    def elevation(self) -> float:
        """Of the normal, degrees."""
        return float(np.rad2deg(np.arcsin(np.clip(self.cutout.normal[2], -1, 1))))

    def plan(self, **options: Any) -> Plan:
        """Return its Plan."""
        obstacles = [] if self.sheet is None else [self.sheet]
        simulator = DirectSimulator(self.rod, gravity=GRAVITY, obstacles=obstacles)
        return InverseSimulator(simulator).thread(self.cutout, **options)


def _followed(rod: OwnRod, path: GripperPath, times: Floats, curve: Curve, case: Case,
              radii: Any) -> tuple[Curve | None, list[float]]:
    """Return the Curve at the last of some times on a path, followed from the first, and rooms."""
    rooms, last = [np.inf], curve
    for u in times[1:]:
        positions, rotations = path.at(u)
        now = rod.solve(positions[0], Rotation.from_matrix(rotations[0]).as_quat(), last.nodes)
        if now is None or not now.minimum:
            return None, rooms
        rooms.append(room(now.dense(), case.cutout, radii, case.sheet))
        last = now
    return last, rooms


def wrong(case: Case, plan: Plan) -> list[str]:
    """Return what is wrong with a Plan, at waypoints and between them."""
    rod, found = OwnRod(case.rod), []
    radius = case.rod.radius
    dense = np.linspace(0, rod.length, FINER * SEGMENTS * STEPS + 1)
    radii = np.array([radius(s) for s in dense.tolist()]) if callable(radius) else radius
    curves = []
    for k, (shape, gripper) in enumerate(zip(plan.shapes, plan.grippers, strict=True)):
        curve = rod.solve(np.array(gripper.position), np.array(gripper.quaternion),
                          rod.guess(shape, rod.natural))
        curves.append(curve)
        if curve is None:
            found.append(f'{k}: no own solution')
            continue
        ends = curve.places[::SEGMENTS], shape.positions_at(rod.s[::2 * SEGMENTS])
        off = float(np.abs(ends[0] - ends[1]).max())
        if off > SAME * rod.length:
            found.append(f'{k}: off by {off / rod.length:.2g} L, stability {shape.stability:.2g}')
        if not curve.minimum:
            found.append(f'{k}: no minimum, stability {shape.stability:.2g}')
        left = room(curve.dense(), case.cutout, radii, case.sheet)
        if left <= 0 or abs(left - plan.clearance[k]) > off + 1e-4 * rod.length:
            found.append(f'{k}: room {left:.3g}, said {plan.clearance[k]:.3g} m')
    path = GripperPath.of(plan)
    for k, (before, after) in enumerate(zip(plan.times[:-1], plan.times[1:], strict=True)):
        one, other = curves[k], curves[k + 1]
        if one is None or other is None:
            continue
        for pieces in PIECES:
            last, lefts = _followed(rod, path, np.linspace(before, after, pieces + 1), one, case,
                                    radii)
            if last is not None and np.abs(last.places - other.places
                                           ).max() <= SAME * rod.length:
                break
        else:
            found.append(f'{k} and on: it falls, or comes to another shape')
        if min(lefts) <= 0:
            found.append(f'{k} and on: room {min(lefts):.3g} m')
    return found


# ------------------------------------------------------------------------------------------------
# Samples.


def passing(case: Case, plan: Plan, count: int, seed: int) -> tuple[float, float]:
    """Return what part of samples touch nothing at any waypoint, and of those that miss by less.

    The latter miss the center by less than the plan's least clearance. Stiffness is known to 2 %,
    mass to 1 %, natural curvature to 0.02 1/m, the gripper to 1 mrad about each axis.
    """
    rng, rod, passed, near = np.random.default_rng([seed, 44]), OwnRod(case.rod), 0, 0
    nominal = [rod.solve(np.array(gripper.position), np.array(gripper.quaternion),
                         rod.guess(shape, rod.natural))
               for shape, gripper in zip(plan.shapes, plan.grippers, strict=True)]
    least = float(plan.clearance.min())
    for _ in range(count):
        sample = OwnRod(case.rod, GRAVITY, np.exp(0.02 * rng.normal()), np.exp(
            0.01 * rng.normal()), tuple(0.02 * rng.normal(size=2)))
        turn = Rotation.from_rotvec(1e-3 * rng.normal(size=3))
        touches = misses = False
        for k, gripper in enumerate(plan.grippers):
            curve = sample.solve(
                np.array(gripper.position),
                (turn * Rotation.from_quat(gripper.quaternion)).as_quat(), nominal[k].nodes)
            if curve is None or not curve.minimum:
                touches = misses = True
                break
            touches = touches or room(curve.dense(), case.cutout, case.rod.radius) <= 0
            place, tangent = curve.at(1 - plan.depths[k] / rod.length)
            off = place - case.cutout.center
            misses = misses or bool(np.linalg.norm(off - off @ tangent * tangent) > least)
        passed, near = passed + (not touches), near + (not misses)
    return passed / count, near / count


def print_wire(count: int, seed: int) -> None:
    """Print what part of samples of the measured wire pass."""
    for elevation, goal in GOALS.items():
        case = Case(WIRE, CutOut(Pose.looking_along((0.1, 0.2, 1.0), normal(elevation)),
                                 radius=0.01))
        for words, options in (('as it has to', {}), ('along the normal',
                                                      {'max_misalignment': 0})):
            begun = process_time()
            try:
                plan = case.plan(**options)
            except Infeasible as error:
                print(f'{elevation:+d} deg, {words}: refused ({error.constraint})', flush=True)
                continue
            used = process_time() - begun
            touch, miss = passing(case, plan, count, seed)
            print(f'{elevation:+d} deg, {words}: tilt {plan.misalignment.max():.2f} rad, clearance '
                  f'{1e3 * plan.clearance.min():.2f} mm, margin {1e3 * plan.margin.min():.2f} mm, '
                  f'stability {plan.stability.min():.3f}, {used:.2f} s of CPU; of {count} samples '
                  f'{touch:.3f} touch nothing (goal {goal}), {miss:.3f} miss by less than the '
                  f'least clearance; wrong: {wrong(case, plan)}', flush=True)


# ------------------------------------------------------------------------------------------------
# Random ones.


def drawn(seed: int, index: int, low: float, high: float, bent: bool = False) -> Case:
    """Return a random Case, w L^3/EI between low and high."""
    rng = np.random.default_rng([seed, index, int(bent)])
    length = float(np.exp(rng.uniform(np.log(0.15), np.log(1.5))))
    ratio = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    mass = float(np.exp(rng.uniform(np.log(0.01), np.log(0.2))))
    stiffness = mass * 9.80665 * length**3 / ratio
    radius = length * float(np.exp(rng.uniform(np.log(0.002), np.log(0.01))))
    around = rng.uniform(0, 2 * np.pi)
    size = float(rng.uniform(0.2, 1.5) / length) if bent else 0.0
    curvature = size * np.cos(around), size * np.sin(around)
    direction = rng.normal(size=3)
    pose = Pose.looking_along(rng.uniform(-1, 1, 3), direction / np.linalg.norm(direction))
    return Case(Rod(length, mass, stiffness, stiffness * rng.uniform(0.6, 0.95), radius=radius,
                    natural_curvature=curvature),
                CutOut(pose, radius=radius * float(rng.uniform(3, 20))))


def judged(name: str, cases: Iterator[Case]) -> None:
    """Plan Cases; print how many get a plan, by elevation, what is wrong, and times."""
    tried, planned, times = [], [], []
    errors = shapes = 0
    for index, case in enumerate(cases):
        begun = process_time()
        tried.append(case.elevation)
        try:
            plan = case.plan()
        except Infeasible as error:
            planned.append(False)
            if case.elevation < -10:
                print(f'  {name} {index}, {case.elevation:.0f} deg: {error}', flush=True)
            continue
        except DloPlannerError as error:
            planned.append(False)
            print(f'  {name} {index}: {error!r}', flush=True)
            continue
        planned.append(True)
        times.append(process_time() - begun)
        shapes += 3 * len(plan) - 2
        found = wrong(case, plan)
        if found:
            errors += 1
            print(f'  {name} {index}, {case.elevation:.0f} deg: {found[:4]}', flush=True)
    elevations, good = np.array(tried), np.array(planned)
    down = elevations < -10
    print(f'{name}: planned below -10 degrees {good[down].sum()} of {down.sum()}, in all '
          f'{good.sum()} of {good.size}; {errors} wrong, {shapes} shapes looked at; CPU of a plan '
          f'{np.median(times):.2f} s in the middle, {np.max(times):.2f} s at most', flush=True)


def print_soft(count: int, seed: int) -> None:
    """Print how many of random soft DLOs get a plan."""
    judged('straight', (drawn(seed, k, 10, 1000) for k in range(count)))
    judged('bent', (drawn(seed, k, 10, 1000, bent=True) for k in range(count // 2)))


class _Taper:
    """A value that falls along the rod to a part of what it is at the gripper."""

    def __init__(self, value: Any, end: float, length: float, power: int) -> None:
        self.value, self.end, self.length, self.power = value, end, length, power

    def __call__(self, s: float) -> float:
        return self.value * (1 + (self.end - 1) * s / self.length)**self.power


def _of_kind(kind: str, case: Case, rng: np.random.Generator) -> Case:
    rod, cutout = case.rod, case.cutout
    radius = float(rod.radius)
    if kind in ('thick sheet', 'slot'):
        if kind == 'slot':
            sides = cutout.radius * 2 * rng.uniform(0.6, 1.2, 2)
            cutout = CutOut(cutout.pose, width=float(sides[0]), height=float(sides[1]))
        thick = float(radius * rng.uniform(0.5, 4)) if kind == 'thick sheet' else radius
        return Case(rod, cutout, Sheet(cutout.pose, 4.0, 4.0, thick, (cutout,)))
    if kind == 'plugged':
        return replace(case, rod=replace(rod, tip_mass=float(
            rod.mass_per_length * rod.length * rng.uniform(0.05, 0.5))))
    if kind == 'tapered':
        end = float(rng.uniform(0.5, 0.9))
        return replace(case, rod=Rod(
            rod.length, _Taper(rod.mass_per_length, end, rod.length, 2),
            _Taper(rod.bending_stiffness[0], end, rod.length, 4),
            _Taper(rod.torsional_stiffness, end, rod.length, 4),
            radius=_Taper(radius, end, rod.length, 1)))
    return replace(case, rod=replace(rod, yield_curvature=float(rng.uniform(5, 20) / rod.length)))


def print_kinds(count: int, seed: int) -> None:
    """Print the same of other sheets and DLOs."""
    for kind in ('thick sheet', 'slot', 'plugged', 'tapered', 'plastic'):
        judged(kind, (_of_kind(kind, drawn(seed, 1000 + k, 10, 300), np.random.default_rng(
            [seed, k, 9])) for k in range(count)))


def print_stiff(count: int, seed: int) -> None:
    """Print whether stiff DLOs pass as along the normal, and in what time."""
    same, times = 0, np.zeros(2)
    drawn(seed, 0, 0.05, 1.0).plan()  # what is loaded once
    for index in range(count):
        case, answers = drawn(seed, index, 0.05, 1.0, bent=bool(index % 2)), []
        for which, options in enumerate(({'max_misalignment': 0}, {})):
            begun = process_time()
            try:
                answers.append(case.plan(**options))
            except Infeasible as error:
                answers.append(error.constraint)
            times[which] += process_time() - begun
        alike = answers[0] == answers[1]
        same += alike
        if not alike:
            print(f'  stiff {index}: {answers}', flush=True)
    print(f'stiff: {same} of {count} are the same; CPU {times[0]:.1f} s along the normal, '
          f'{times[1]:.1f} s as it has to, ratio {times[1] / times[0]:.2f}', flush=True)


# ------------------------------------------------------------------------------------------------
# Bores.

# of bores: radius over that of the DLO, and depth over that, from and to; the last one of at most
# 0.4 of the length
BORES = {'tight': (1.02, 1.2, 2.0, np.inf), 'medium': (1.5, 6.0, 2.0, np.inf),
         'wide and short': (4.0, 21.0, 1.0, 8.0)}


def highest(rod: Rod, length: float) -> float:
    """Return the largest elevation, rad, of the free end of a DLO of a length, m, that stands."""
    shapes = reachable_shapes(DirectSimulator(replace(rod, length=length), gravity=GRAVITY), 0.01,
                              lambda: None)
    return -np.pi / 2 if shapes is None else float(
        np.arcsin(np.clip(shapes.frames[:, -1, 2, 0], -1, 1)).max())


def print_bores(count: int, seed: int) -> None:
    """Print how many random soft DLOs go into bores along them, and obliquely."""
    for kind, (narrow, wide, short, deep) in BORES.items():
        rng, tally, errors = np.random.default_rng([seed, count]), np.zeros(3, int), 0
        for index in range(count):
            case = drawn(seed, 7000 + index, 3, 300)
            rod, radius, cutout = case.rod, float(case.rod.radius), case.cutout
            room = radius * float(np.exp(rng.uniform(np.log(narrow - 1), np.log(wide - 1))))
            depth = float(np.exp(rng.uniform(np.log(short * radius), np.log(
                min(deep * radius, 0.4 * rod.length)))))
            bore = CutOut(cutout.pose, radius=radius + room)
            inverse = InverseSimulator(DirectSimulator(rod, gravity=GRAVITY))
            depths = np.linspace(0, depth, 6)
            try:
                inverse.insert(bore, depths=depths, max_misalignment=0)
                tally[0] += 1
                continue
            except Infeasible:
                pass
            # the tilt that the mouth leaves, against what the DLO lacks to be along the bore
            lacks = [np.deg2rad(case.elevation) - highest(rod, rod.length - at) - (
                np.arcsin(min(1.0, 2 * room / at)) if at else np.pi / 2)
                for at in np.linspace(0, depth, 25).tolist()]
            tally[1] += max(lacks) <= 0
            try:
                plan = inverse.insert(bore, depths=depths)
            except Infeasible:
                continue
            tally[2] += 1
            (sheet, _), = plan.sheets
            found = wrong(Case(rod, sheet.cutouts[0], sheet), plan)
            if found:
                errors += 1
                print(f'  {kind} {index}: {found[:4]}', flush=True)
        along, allowed, oblique = tally.tolist()
        print(f'{kind}: of {count}, {along} go in along the bore; of the {count - along} others '
              f'the mouth may allow {allowed}, {oblique} go in obliquely, {errors} wrong',
              flush=True)


# ------------------------------------------------------------------------------------------------
# Advice.

_HELD = re.compile(r'held at most ([\d.e-]+) m')
_TURNED = re.compile(r'downwards by ([\d.e-]+) degrees')
_LARGER = re.compile(r'hole of radius ([\d.e-]+) m')
INSIDE, OUTSIDE = 1.07, 1.08


def changed(case: Case, lever: str, value: float) -> Case:
    """Return a Case whose lever is at a value: m of free length, degrees, m of radius."""
    cutout = case.cutout
    if lever == 'held':
        return replace(case, rod=replace(case.rod, length=value))
    if lever == 'larger':
        return replace(case, cutout=CutOut(cutout.pose, radius=value))
    across = np.cross(cutout.normal, (0.0, 0.0, -1.0))
    turn = Rotation.from_rotvec(np.deg2rad(value) * across / np.linalg.norm(across))
    return replace(case, cutout=CutOut(Pose.looking_along(
        cutout.center, turn.as_matrix() @ cutout.normal), radius=cutout.radius))


def gets_a_plan(case: Case) -> bool:
    """Whether there is a plan of a Case."""
    try:
        case.plan()
    except Infeasible:
        return False
    return True


def print_advice(count: int, seed: int) -> None:
    """Print of how many refusals the levers hold that are named."""
    right = {lever: [0, 0, 0] for lever in ('held', 'turned', 'larger')}
    times, index, refused, without = [], 0, 0, 0
    while refused < count:
        case = drawn(seed, 5000 + index, 10, 1000)
        index += 1
        try:
            case.plan()
            continue
        except Infeasible as error:
            refused += 1
            begun = process_time()
            advice = error.advice
            times.append(process_time() - begun)
        without += not advice
        for lever, words, inside, outside in (('held', _HELD, 1 / INSIDE, OUTSIDE),
                                              ('turned', _TURNED, INSIDE, 1 / OUTSIDE),
                                              ('larger', _LARGER, INSIDE, 1 / OUTSIDE)):
            found = words.search(advice)
            if not found:
                continue
            bound = float(found[1])
            good = gets_a_plan(changed(case, lever, inside * bound))
            bad = gets_a_plan(changed(case, lever, outside * bound))
            tally = right[lever]
            tally[0], tally[1], tally[2] = tally[0] + 1, tally[1] + good, tally[2] + (not bad)
            if bad or not good:
                print(f'  refusal {index - 1}, {case.elevation:.0f} deg, {lever} {bound:g}: '
                      f'{"plans" if good else "is refused"} inside, '
                      f'{"plans" if bad else "is refused"} outside', flush=True)
    for lever, (named, good, bad) in right.items():
        print(f'{lever}: named {named} times, {good} plan 7 % inside, {bad} are refused 8 % '
              'outside', flush=True)
    print(f'{refused} refusals, {without} without advice; CPU of the advice {np.median(times):.2f} '
          f's in the middle, {np.max(times):.2f} s at most', flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Run."""
    jobs = {'wire': print_wire, 'soft': print_soft, 'kinds': print_kinds, 'stiff': print_stiff,
            'advice': print_advice, 'bores': print_bores}
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=list(jobs))
    parser.add_argument('count', type=int)
    parser.add_argument('seed', type=int, nargs='?', default=0)
    given = parser.parse_args(arguments)
    jobs[given.what](given.count, given.seed)


if __name__ == '__main__':
    main()
