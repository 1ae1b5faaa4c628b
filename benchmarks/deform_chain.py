# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in the layout of the DEFORM data set, made here: two grippers move a cable.

`by_chain` shares nothing with the package: a chain of points with stiff springs between neighbors
and the bending force of discrete elastic rods without twist (Bergou et al. 2008, Eq. 1 and 2, for a
straight round rod whose far end may turn), in short explicit steps.
"""

import pickle

import numba
import numpy as np
from scipy.optimize import brentq

DT = 0.01
_SPRINGS = 2e3  # N, of a strain of 1: it stretches by some 1e-4
_SUBSTEPS = 250


def grips(seed, frames, length, stub):
    """Return clamped markers (frames, 4, 3): two on each gripper, `stub` m apart."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(frames)[:, None]

    def wave(size):
        rates, phases = rng.uniform(0.2, 0.7, (2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
        return size * sum(np.sin(2 * np.pi * rate * t + phase)
                          for rate, phase in zip(rates, phases, strict=True)) / 2

    near = np.array([0.0, 0.0, 0.5]) + wave(0.1 * length)
    far = np.array([0.72 * length, 0.0, 0.5]) + wave(0.1 * length)
    first = np.array([1.0, 0.0, -0.4]) + wave(0.3)
    last = np.array([1.0, 0.0, 0.4]) + wave(0.3)
    first, last = (stub * way / np.linalg.norm(way, axis=1)[:, None] for way in (first, last))
    return np.stack([near - first, near, far, far + last], axis=1)


@numba.njit(cache=False)
def _cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@numba.njit(cache=False)
def _forces(x, h, stiffness, springs, force):
    """Write minus the gradient of the energy of stretching and bending of points x (n, 3).

    E = B |kb|^2 / (2 h) with kb = 2 e x f / (h^2 + e f) between neighboring edges e, f;
    d kb / d e = -(2 [f] + kb f^T) / (h^2 + e f), d kb / d f = (2 [e] - kb e^T) / (h^2 + e f).
    """
    n = len(x)
    force[:] = 0
    for i in range(n - 1):
        size = 0.0
        for k in range(3):
            size += (x[i + 1, k] - x[i, k]) ** 2
        size = np.sqrt(size)
        pull = springs * (size / h - 1) / size
        for k in range(3):
            force[i, k] += pull * (x[i + 1, k] - x[i, k])
            force[i + 1, k] -= pull * (x[i + 1, k] - x[i, k])
    for i in range(1, n - 1):
        e = (x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1], x[i, 2] - x[i - 1, 2])
        f = (x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1], x[i + 1, 2] - x[i, 2])
        dot = h * h + e[0] * f[0] + e[1] * f[1] + e[2] * f[2]
        c = _cross(e, f)
        kb = (2 * c[0] / dot, 2 * c[1] / dot, 2 * c[2] / dot)
        square = kb[0] ** 2 + kb[1] ** 2 + kb[2] ** 2
        # at a gripper only the half of a piece beyond it bends
        hinge = stiffness / (h * dot) * (2 if i in (1, n - 2) else 1)
        over_f, over_e = _cross(f, kb), _cross(e, kb)
        for k in range(3):
            by_e = (2 * over_f[k] - square * f[k]) * hinge
            by_f = (-2 * over_e[k] - square * e[k]) * hinge
            force[i - 1, k] += by_e
            force[i, k] += by_f - by_e
            force[i + 1, k] -= by_f


@numba.njit(cache=False)
def _run(x, ends, h, node_mass, stiffness, springs, drag, substeps, dt):
    """Return (frames, n, 3) of points x (n, 3), the outer two at each end along ends; drag: 1/s."""
    frames, n = len(ends), len(x)
    out = np.empty((frames, n, 3))
    out[0] = x
    v, force = np.zeros_like(x), np.zeros_like(x)
    step = dt / substeps
    for frame in range(1, frames):
        for k in range(substeps):
            part = (k + 1.0) / substeps
            _forces(x, h, stiffness, springs, force)
            for i in range(2, n - 2):
                force[i, 2] -= 9.81 * node_mass
                for j in range(3):
                    v[i, j] += step * (force[i, j] / node_mass - drag * v[i, j])
                    x[i, j] += step * v[i, j]
            for end, i in enumerate((0, 1, n - 2, n - 1)):
                for j in range(3):
                    before = ends[frame - 1, end, j]
                    x[i, j] = before + part * (ends[frame, end, j] - before)
        out[frame] = x
    return out


def _hung(x, length):
    """Return points (n, 3) on a straight way, hung as a parabola of a length in m."""
    s = np.linspace(0, 1, len(x))
    dip = np.column_stack([0 * s, 0 * s, -4 * s * (1 - s)])
    sag = brentq(lambda sag: np.linalg.norm(np.diff(x + sag * dip, axis=0), axis=1).sum() - length,
                 0, length)
    return x + sag * dip


def by_chain(seed, frames, length, mass, stiffness, drag, markers=12):
    """Return a recording (frames, markers, 3), m, of a straight cable; drag: 1/s."""
    pieces = 4 * (markers - 3)
    h = length / pieces
    held = grips(seed, frames, length, h)
    settle = np.repeat(held[:1], 200, axis=0)
    s = np.linspace(0, 1, pieces + 1)[:, None]
    x = (1 - s) * held[0, 1] + s * held[0, 2]
    x = _hung(x, length)
    x = np.concatenate([held[0, :1], x, held[0, 3:]])
    for calm in (300.0, 8.0):  # 1/s: it creeps off the parabola first
        x = _run(x, settle, h, mass * h, stiffness, _SPRINGS, calm, _SUBSTEPS, DT)[-1]
    ramp = np.clip(np.arange(frames) * DT, 0, 1)[:, None, None]  # it begins to move smoothly
    held = held[0] + ramp**2 * (3 - 2 * ramp) * (held - held[0])
    way = _run(x, held, h, mass * h, stiffness, _SPRINGS, drag, _SUBSTEPS, DT)
    inner = 1 + 4 * np.arange(markers - 2)
    assert np.abs(way).max() < 10 * length
    return way[:, [0, *inner, pieces + 2]], held


def save(root, cable, part, recordings, noise=0.0):
    """Write recordings as files of a data set, with normal errors of the markers."""
    folder = root / 'data_set' / f'DLO{cable}' / part
    folder.mkdir(parents=True)
    rng = np.random.default_rng(len(recordings))
    for number, markers in enumerate(recordings):
        seen = markers + noise * rng.standard_normal(markers.shape)
        with (folder / f'{number}.pkl').open('wb') as file:
            pickle.dump([frame.T.tolist() for frame in seen], file)
