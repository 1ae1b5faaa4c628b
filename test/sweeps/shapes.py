# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random shapes beside SciPy's: minima and their errors, properties that jump, both ends held.

Its boundary value solver on the Kirchhoff equations finds the equilibrium next to an answer, and
Jacobi's condition, integrated from the free end, tells whether that is a minimum.
"""

import numpy as np
from references.kirchhoff import equilibrium, is_minimum, true_held_rod
from references.stepped import random_stepped
from scipy.spatial.transform import Rotation

from dlo_planner import Capsule, DirectSimulator, Pose, Rod
from sweeps import Outcome, timed

MESHES = [{'basis': 'local', 'n_elements': n} for n in (32, 64, 128)] + [
    {'n_elements': 64, 'n_terms': 6}, {}, {'n_elements': 128, 'n_terms': 20},
    {'basis': 'fourier', 'n_terms': 16}]
JUMPS_ON = [{}, {'accuracy': 1e-5}, {'n_elements': 64}, {'basis': 'local', 'n_elements': 50}]
SAMPLES = np.linspace(0, 1, 41)
SPANS = {'slack': (0.65, 0.95), 'tight': (0.95, 0.99), 'taut': (0.99, 0.999)}  # of the length
PEG = Capsule((0.4, -1, -0.25), (0.4, 1, -0.25), 0.05)
_EVERY = 15      # of the rods have their errors looked at
_SOFT = 100.0    # w L^3 / EI beyond which seven meshes of 32 to 128 elements are too coarse
_EXACT = 1e-7    # of the length: SciPy's solutions are not asked for errors of this size


# ---- any rod in any gripper -----------------------------------------------------------------


def random_hanging(rng, softest=1e5):
    """Return a Rod of 1 m and a gripper's Pose, any of them."""
    load = np.exp(rng.uniform(np.log(0.1), np.log(softest)))  # w L^3 / EI
    ratio = np.exp(rng.uniform(0, np.log(1e3)))
    stiffness = (1.0, ratio) if rng.random() < 0.5 else (ratio, 1.0)
    turns = 2 * np.pi * rng.uniform(-3, 3, 3) * (rng.random(3) < 0.5)  # several, or none
    rod = Rod(1.0, load / 9.81, stiffness, np.exp(rng.uniform(np.log(0.1), np.log(10))),
              natural_curvature=tuple(turns[1:]), natural_twist=turns[0])
    return rod, Pose(rng.normal(size=3), rng.normal(size=4))


def verdict(rod, gripper):
    """Return 'a minimum', or what is wrong with the shape found."""
    shape = DirectSimulator(rod).solve(gripper)
    if not shape.converged:
        return 'not called converged'
    try:
        true = equilibrium(rod, gripper, shape, tol=1e-7)
    except AssertionError:
        return 'no equilibrium of SciPy'
    if not error_of(shape, true) < 10 * shape.error_estimate:
        return 'far from the true rod'
    return 'a minimum' if is_minimum(rod, true) else 'a saddle'


def error_of(shape, true):
    """Return the largest distance (m) of a Shape's nodes from a solution of `equilibrium`."""
    return np.linalg.norm(shape.positions - true(shape.s)[:3].T, axis=1).max()


def error_ratios(rod, gripper):
    """Return error estimate over true error of each mesh, nan where it is another shape.

    A fine one only tells SciPy which equilibrium is meant.
    """
    fine = DirectSimulator(rod, accuracy=1e-4, basis='local').solve(gripper)
    true, ratios = equilibrium(rod, gripper, fine, tol=1e-9), []
    for options in MESHES:
        shape = DirectSimulator(rod, **options).solve(gripper)
        error = error_of(shape, true)
        ratios.append(shape.error_estimate / error if 20 * _EXACT < error < 0.1 else np.nan)
    return ratios


def rods(number, seed):
    """Yield the Outcomes of random rods, and of the errors of some on seven meshes."""
    rng = np.random.default_rng(seed)
    for index in range(number):
        yield Outcome(*timed(verdict, *random_hanging(rng)))
        if index % _EVERY == 0:
            for ratio in error_ratios(*random_hanging(rng, _SOFT)):
                yield Outcome('good' if not ratio < 0.1 else 'estimate too small', ratio=ratio)


# ---- properties that jump -------------------------------------------------------------------


def stepped(rng):
    """Yield the Outcome of each way to solve one random rod."""
    true, gripper = random_stepped(rng), Pose((0, 0, 0), rng.normal(size=4))
    rod = Rod(1.0, true.of(true.mass, scalar=True), true.of(true.stiffness[:, 1:]),
              true.of(true.stiffness[:, 0], scalar=True),
              natural_curvature=true.of(true.natural[:, 1:]),
              natural_twist=true.of(true.natural[:, 0], scalar=True))
    for options in JUMPS_ON:
        simulator = DirectSimulator(rod, load=true.of(true.load), **options)
        shape = simulator.solve(gripper)
        if not shape.converged:
            yield Outcome('not converged')
            continue
        try:
            exact = true.shape(gripper, shape.frames[-1], SAMPLES)
        except AssertionError:
            yield Outcome('without reference')
            continue
        off = np.linalg.norm(shape.positions_at(SAMPLES) - exact, axis=1).max()
        ratio = shape.error_estimate / off
        kept = simulator.accuracy is None or off <= simulator.accuracy
        what = 'good' if kept and ratio > 0.1 or off < 1e-8 else (
            'accuracy missed' if not kept else 'estimate too small')
        yield Outcome(what, ratio=ratio if off > 1e-8 else np.nan)


def jumps(number, seed):
    """Yield the Outcomes of random rods whose properties jump."""
    rng = np.random.default_rng(seed)
    for _ in range(number):
        yield from stepped(rng)


# ---- both ends held -------------------------------------------------------------------------


def cable(load, torsion=None):
    """Return a round rod of 1 m whose weight is `load` times EI / L^2."""
    one = Rod.circular(1.0, 3e-3, 1200, 1e9, 0.4)
    modulus = 1e9 * one.mass_per_length * 9.81 / one.bending_stiffness[0] / load
    rod = Rod.circular(1.0, 3e-3, 1200, modulus, 0.4)
    if torsion is None:
        return rod
    stiff = rod.bending_stiffness[0]
    return Rod(1.0, rod.mass_per_length, stiff, torsion * stiff, radius=rod.radius)


def poses(count, seed=1, spans=(0.65, 0.95)):
    """Yield pairs of a gripper and a far end, both turned, as far apart as `spans` say, m."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        distance = rng.uniform(*spans)
        way = np.array([1, 0, rng.uniform(-0.3, 0.3)])
        turns = [Rotation.from_rotvec(rng.uniform(-0.8, 0.8, 3)).as_quat() for _ in range(2)]
        yield Pose((0, 0, 0), turns[0]), Pose(distance * way / np.linalg.norm(way), turns[1])


def beside_scipy(rod, shape, span):
    """Return the Outcome of a cable that is held at both ends: 'right', 'refused' or 'wrong'."""
    if not shape.converged:
        return Outcome(f'refused {span}')
    try:
        true = true_held_rod(rod, shape, tol=1e-6)
    except AssertionError:
        return Outcome('wrong', ratio=0.0)
    ratio = shape.error_estimate / np.linalg.norm(true - shape.positions, axis=1).max()
    return Outcome('right' if ratio > 0.1 else 'wrong', ratio=ratio)


def solved_and_moved(direct, gripper, end):
    """Yield the Outcomes of a held cable from its natural shape, and for a small step."""
    shape, seconds = timed(direct.solve, gripper, far_end=end)
    yield Outcome('converged' if shape.converged else 'not converged', seconds)
    moved = Pose(end.position + np.array([0.002, 0.001, 0]), end.quaternion)
    shape, seconds = timed(direct.solve, gripper, shape, far_end=moved)
    yield Outcome('converged, a step' if shape.converged else 'not converged, a step', seconds)


def held(number, seed):
    """Yield the Outcomes of cables beside SciPy, and of all of them free and over a peg."""
    for span, bounds in SPANS.items():
        for load in (30.0, 1e3, 1e4, 1e5):
            rod = cable(load)
            direct = DirectSimulator(rod, accuracy=1e-3)
            for gripper, end in poses(2 * number, seed, bounds):
                yield beside_scipy(rod, direct.solve(gripper, far_end=end), span)
    cables = [(cable(load), basis, obstacles) for load in (1e3, 3.5e3, 1e4, 1e5)
              for basis in ('local', 'chebyshev') for obstacles in ((), (PEG,))]
    cables += [(cable(load, 1e-4), 'local', ()) for load in (1.0, 1e3, 1e5)]
    for rod, basis, obstacles in cables:
        direct = DirectSimulator(rod, basis=basis, obstacles=obstacles)
        for gripper, end in poses(number, seed):
            yield from solved_and_moved(direct, gripper, end)
