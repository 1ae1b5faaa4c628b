# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random DLOs in one to three holds, slack to taut, beside Kirchhoff's equations.

`python -m benchmarks.holds [COUNT] [SEED]` (20, 0; some seconds each) solves them with
accuracy=1e-6 and compares places of nodes with a solver of its own: multiple shooting over all
spans (Stoer and Bulirsch, 7.3.5), by Runge and Kutta's method, each solution looked at by SciPy's
DOP853. Nothing of the package is in it but the first guess. Three quarters of the sets have slacks
of 1e-2 to 0.2, the others of 1e-5 to 1e-2, where tension is up to 1e6 times the force that bends.
"""

import sys
from time import process_time

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import bmat, csc_matrix, diags
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Hold, Pose, Rod
from dlo_planner.model.holds import GRIPS

_ACCURACY = 1e-6    # of the length of 1 m
_STEPS = 24         # of an interval
_INTERVALS = 60     # in a span, at most where it is slack
_GROWTH = 4.0       # bending lengths in an interval, at most: beyond, errors grow too far in one
_ROUNDS = 60
_FOUND = 1e-9       # of the scales, the last correction
_CHECKED = 1e-8     # of the scales, by DOP853


def rates(y, stiffness, weight):
    """Return d/ds of places, quaternions, forces and moments carried from beyond (..., 13)."""
    q, force, moment = y[..., 3:7], y[..., 7:10], y[..., 10:13]
    turned = Rotation.from_quat(q.reshape(-1, 4)).as_matrix().reshape(*y.shape[:-1], 3, 3)
    strain = np.einsum('...ji,...j->...i', turned, moment) / stiffness
    spin, tangent = np.einsum('...ij,...j->...i', turned, strain), turned[..., 0]
    turn = 0.5 * np.concatenate([
        q[..., 3:] * spin + np.cross(spin, q[..., :3]),
        -np.sum(spin * q[..., :3], axis=-1, keepdims=True)], axis=-1)
    return np.concatenate([tangent, turn, np.broadcast_to(-weight, tangent.shape),
                           -np.cross(tangent, force)], axis=-1)


def carried(y, h, stiffness, weight):
    """Return y (..., M, 13) at the ends of intervals h (M,), by Runge and Kutta's method."""
    step = (h / _STEPS)[:, None]
    for _ in range(_STEPS):
        one = rates(y, stiffness, weight)
        two = rates(y + 0.5 * step * one, stiffness, weight)
        three = rates(y + 0.5 * step * two, stiffness, weight)
        four = rates(y + step * three, stiffness, weight)
        y = y + step / 6 * (one + 2 * two + 2 * three + four)
    return y


def missed(hold, y):
    """Return what a Hold holds of y (..., 13), as it is missed."""
    turned = Rotation.from_quat(y[..., 3:7].reshape(-1, 4)).as_matrix().reshape(
        *y.shape[:-1], 3, 3)
    inside = hold.pose.rotation.T @ turned
    turn = 0.5 * np.stack([inside[..., k, j] - inside[..., j, k]
                           for j, k in ((1, 2), (2, 0), (0, 1))], axis=-1)
    away = y[..., :3] - hold.pose.position
    across = (away @ hold.pose.rotation)[..., 1:]
    return {'clamped': lambda: np.concatenate([away, turn], axis=-1), 'pinned': lambda: away,
            'aligned': lambda: np.concatenate([away, inside[..., 1:, 0]], axis=-1),
            'sleeve': lambda: np.concatenate([across, turn], axis=-1)}[hold.grip]()


def free(hold):
    """Return (k, 13) what of force and moment a Hold cannot exert."""
    rows, axis = np.zeros((3, 13)), hold.pose.direction
    if hold.grip == 'pinned':
        rows[:, 10:] = np.eye(3)
        return rows
    if hold.grip == 'clamped':
        return rows[:0]
    rows[0, slice(10, 13) if hold.grip == 'aligned' else slice(7, 10)] = axis
    return rows[:1]


def slopes(function, y, scale):
    """Return (n, k, 13) differences of a function of y (n, 13)."""
    steps = 1e-6 * np.diag(scale)
    ahead, back = (function(y + way * steps[:, None]) for way in (1, -1))
    return np.moveaxis((ahead - back) / (2e-6 * scale[:, None, None]), 0, -1)


def first_guess(shape, holds, stiffness, weight):
    """Return ends (M + 1,) of intervals, the last one of each span, and y (M, 13) at beginnings."""
    length = float(shape.s[-1])
    ends = [length if hold.s is None else hold.s for hold in holds]
    ends += [length] if ends[-1] < length else []
    s, last, guess = [0.0], [], []
    middles, force = 0.5 * (shape.s[1:] + shape.s[:-1]), shape.gripper_wrench[:3]
    for k, end in enumerate(ends):
        begin = s[-1]
        elements = (middles > begin) & (middles < end)
        nodes = shape.s[(shape.s > begin + 1e-12) & (shape.s < end - 1e-12)]
        nodes = nodes[::max(1, int(np.ceil(len(nodes) / _INTERVALS)))]
        bend = np.sqrt(stiffness.max() / max(np.linalg.norm(force), 1e-9))
        for node in [*nodes, end]:
            parts = int(np.ceil((node - s[-1]) / (_GROWTH * bend)))
            s += np.linspace(s[-1], node, max(parts, 1) + 1)[1:].tolist()
        for at in (one for one in s if begin <= one < end):
            axes, place = shape.frame_at(at)
            strain = [np.interp(at, middles[elements], column)
                      for column in shape.element_strains[elements].T]
            guess.append([*place, *Rotation.from_matrix(axes).as_quat(), *-(force + weight * at),
                          *axes @ (stiffness * strain)])
        last.append(len(s) - 2)
        if k < len(holds):
            force = force + shape.wrenches[k, :3]
    y = np.array(guess)
    y[:, 3:7] *= np.cumprod([1.0, *np.where(np.sum(y[1:, 3:7] * y[:-1, 3:7], axis=1) < 0, -1, 1)])[
        :, None]
    return np.array(s), last, y


def reference(shape, gripper, holds, stiffness, weight):
    """Return a function of s (n,) with places (n, 3); None where no solution was found."""
    s, last, y = first_guess(shape, holds, stiffness, weight)
    h, count, known, part = np.diff(s), len(y), np.inf, 1.0
    scale = np.concatenate([[0.1] * 3, [1.0] * 4, [max(np.abs(y[:, 7:10]).max(), stiffness.max())]
                            * 3, [max(np.abs(y[:, 10:]).max(), 0.1 * stiffness.max())] * 3])
    begin = np.concatenate([gripper.position, y[0, 3:7]])
    base, step = y, np.zeros_like(y)
    for _ in range(_ROUNDS):
        end = carried(y, h, stiffness, weight)
        jacobian = slopes(lambda one: carried(one, h, stiffness, weight), y, scale)
        rows, left = [[(0, np.eye(7, 13))]], [y[0, :7] - begin]
        for i in range(count):
            hold = holds[last.index(i)] if i in last and last.index(i) < len(holds) else None
            if i not in last:
                rows.append([(i, jacobian[i]), (i + 1, -np.eye(13))])
                left.append(end[i] - y[i + 1])
                continue
            if hold is None:
                rows.append([(i, jacobian[i, 7:])])
                left.append(end[i, 7:])
                continue
            by = slopes(lambda one, hold=hold: missed(hold, one), end[i:i + 1], scale)[0]
            rows.append([(i, by @ jacobian[i])])
            left.append(missed(hold, end[i]))
            kept, beyond = free(hold), i + 1 < count
            if beyond:
                kept = np.vstack([np.eye(7, 13), kept])
            rows.append([(i, kept @ jacobian[i]), *([(i + 1, -kept)] if beyond else [])])
            left.append(kept @ (end[i] - (y[i + 1] if beyond else 0.0)))
        blocks = [[None] * count for _ in rows]
        for line, entries in zip(blocks, rows, strict=True):
            for column, block in entries:
                line[column] = csc_matrix(block) if block.size else None
        kept_rows = [k for k, one in enumerate(left) if len(one)]
        matrix = bmat([blocks[k] for k in kept_rows], format='csc') @ diags(np.tile(scale, count))
        missing = np.concatenate([left[k] for k in kept_rows])
        sizes = abs(matrix).max(axis=1).toarray().ravel()
        size = np.linalg.norm(missing / sizes)
        if not size < known * (1 + 1e-9) and not size < _FOUND and part > 1e-7:
            part *= 0.25
            y = base + part * step
            continue
        known, base = size, y
        step = -spsolve(matrix, missing).reshape(y.shape) * scale
        largest = np.abs(step / scale).max()
        part = min(1.0, 0.5 / largest)
        y = base + part * step
        if largest < _FOUND:
            break
    else:
        return None
    for i in range(0, count, max(1, count // 6)):
        there = solve_ivp(lambda _, one: rates(one, stiffness, weight), (0, h[i]), y[i],
                          method='DOP853', rtol=1e-12, atol=1e-13).y[:, -1]
        off = np.abs((there - carried(y[i:i + 1], h[i:i + 1], stiffness, weight)[0]) / scale).max()
        if not off < _CHECKED:
            return None

    def places(at):
        of = np.clip(np.searchsorted(s, at + 1e-13) - 1, 0, count - 1)
        return carried(y[of], at - s[of], stiffness, weight)[:, :3]

    return places


def drawn(rng):
    """Return Rod, gripper and Holds of a random set."""
    bend = 10 ** rng.uniform(-2, 0)
    mass = float(rng.uniform(0, 0.4)) if rng.random() < 0.7 else 0.0
    rod = Rod(1.0, mass, (bend, float(rng.uniform(0.7, 1.0) * bend)),
              float(rng.uniform(0.5, 1) * bend))
    count = int(rng.integers(1, 4))
    places = np.zeros(count)
    while np.any(np.diff(places, prepend=0) < 0.12):
        places = np.sort(rng.uniform(0.15, 0.95, count))
    if rng.random() < 0.6:
        places[-1] = 1.0
    slack = 10 ** (rng.uniform(-5, -2) if rng.random() < 0.25 else rng.uniform(-2, -0.7))
    grips = GRIPS if slack > 1e-2 else [grip for grip in GRIPS if grip != 'sleeve']
    way = np.array([1.0, 0, 0]) + 0.3 * rng.normal(size=3)
    way /= np.linalg.norm(way)
    gripper = Pose.looking_along(0.1 * rng.normal(size=3), way + 0.3 * rng.normal(size=3))
    at, before, holds = gripper.position, 0.0, []
    for place in places.tolist():
        way = way + 0.3 * rng.normal(size=3)
        way /= np.linalg.norm(way)
        at, before = at + (place - before) * (1 - slack * rng.uniform(0.5, 1)) * way, place
        pose = Pose.looking_along(at, way + 0.3 * rng.normal(size=3))
        holds.append(Hold(pose, str(rng.choice(grips)), None if place == 1.0 else place))
    return rod, gripper, holds


def main(count=20, seed=0):
    """Print how far nodes are from the reference, of `count` sets."""
    rng, errors, times, failed, unknown = np.random.default_rng(seed), [], [], [], 0
    for k in range(count):
        rod, gripper, holds = drawn(rng)
        begun = process_time()
        shape = DirectSimulator(rod, accuracy=_ACCURACY).solve(gripper, holds=holds)
        times.append(process_time() - begun)
        if not shape.converged:
            failed.append(f'set {k}: {shape.status}')
            continue
        bending: tuple[float, float] = rod.bending_stiffness
        places = reference(shape, gripper, holds, np.array([rod.torsional_stiffness, *bending]),
                           np.array([0, 0, -9.81 * rod.mass_per_length]))
        if places is None:
            unknown += 1
            continue
        errors.append(np.linalg.norm(places(shape.s) - shape.positions, axis=1).max())
        grips = ', '.join(hold.grip for hold in holds)
        print(f'set {k}: {grips}: off by {errors[-1]:.1e} m', flush=True)
    print(*failed, sep='\n')
    print(f'{count} sets: {len(failed)} not converged; {len(errors)} compared, {unknown} without '
          f'a reference; error median {np.median(errors):.1e}, largest {np.max(errors):.1e} m, '
          f'accuracy {_ACCURACY:.0e}; a solution takes {np.median(times) * 1e3:.0f} ms of CPU')


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
