# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cases of the direct simulation without obstacles: free, held, on their way, yielding."""

from dataclasses import replace

import numpy as np

from benchmarks.oracle.answers import Answer, Scale, add_shape, touches
from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Observer,
    Plane,
    PointLoad,
    Pose,
    Rod,
    Uncertainty,
    fit_rod,
    solve_many,
)
from dlo_planner.identify import Observation
from dlo_planner.penalties import minimize_penalty
from dlo_planner.results import modes_along
from dlo_planner.rods import GraspedInside, Piecewise, with_plug

HOW = ({}, {'basis': 'local'}, {'n_elements': 64, 'n_terms': 6}, {'n_elements': 128, 'n_terms': 20},
       {'basis': 'local', 'n_elements': 33}, {'basis': 'fourier', 'n_terms': 12},
       {'basis': 'fourier_polynomial', 'n_elements': 64}, {'n_elements': 16})
GRIPS = 'clamped', 'pinned', 'sleeve', 'aligned'


def of_shape(shape, rod, loose=1.0, estimate=True):
    """Return the Answer of one shape."""
    answer = Answer()
    add_shape(answer, shape, rod, loose, estimate)
    return answer


def of_shapes(shapes, rod, loose=1.0, estimate=True):
    """Return the Answer of the shapes of a motion: verdicts of all, and the most telling one.

    That is the last one that is converged and touches, or else the last one.
    """
    touching = [shape.converged and touches(shape, Scale.of(rod)) for shape in shapes]
    telling = [shape for shape, one in zip(shapes, touching, strict=True) if one] or shapes
    answer = of_shape(telling[-1], rod, loose, estimate)
    answer.say('verdicts', ''.join(
        ('j' if shape.jumped else 'c') if shape.converged else 'n' for shape in shapes))
    if any(touching):
        answer.say('touching', ''.join(str(len(one)) if one else '-' for one in touching))
    for name, shape in (('tip halfway', shapes[len(shapes) // 2]), ('tip', shapes[-1])):
        if shape.converged:
            place = of_shape(shape, rod, loose, estimate=False).numbers['positions']
            answer.put(name, shape.positions[-1], place.tolerance)
    return answer


def cold(given):
    """Solve for a pose, without a shape before."""
    rod = given.rod((0.1, 1e4))
    how = HOW[given.number % len(HOW)]
    gravity = (0, 0, -9.81) if given.rng.random() < 0.8 else 9.81 * given.direction()
    return of_shape(DirectSimulator(rod, gravity=gravity, **how).solve(given.anywhere()), rod)


def warm(given):
    """Solve for a pose, from the shape at another."""
    rod = given.rod((0.1, 1e3))
    direct = DirectSimulator(rod, **HOW[given.number % len(HOW)])
    start = given.anywhere()
    size = given.between(0.01, 1.5)
    goal = given.way(start, given.rng.normal(size=3), size * given.direction(), 1)[0]
    return of_shape(direct.solve(goal, direct.solve(start)), rod)


def accurate(given):
    """Solve to an accuracy."""
    rod = given.rod((0.1, 1e3))
    basis = (None, 'chebyshev', 'fourier', None)[given.number % 4]
    direct = DirectSimulator(rod, accuracy=rod.length * given.between(1e-6, 1e-3), basis=basis)
    pose = given.anywhere()
    shape = direct.solve(pose)
    if given.number % 3 == 0:
        shape = direct.solve(given.way(pose, np.zeros(3), 0.1 * given.direction(), 1)[0], shape)
    answer = of_shape(shape, rod)
    answer.say('accurate', shape.error_estimate <= direct.accuracy)
    return answer


def varying(given):
    """Solve for a DLO that varies along its length, with loads at points, a plug, or masses."""
    rng, length = given.rng, given.between(0.3, 3.0)
    stiff = 0.05 * 9.81 * length**3 / given.between(0.3, 100)
    kind = given.number % 4
    more, options = {}, {}
    if kind == 0:
        ends = rng.uniform(0.3, 2, 4) * stiff
        at = rng.uniform(0.2, 0.8) * length
        bending = ((0.0, ends[0]), (at, ends[1]), (at, ends[2]), (length, ends[3]))
        rod = Rod(length, ((0.0, 0.05), (length, 0.02)), bending, 0.7 * stiff, radius=1e-3)
    elif kind == 1:
        at = rng.uniform(0.2, 0.8) * length
        rod = Rod(length, 0.05, stiff, Piecewise(lambda s: stiff * (0.5 if s < at else 1.5), [at]),
                  natural_curvature=(lambda s: np.sin(3 * s / length) / length, 0.3 / length))
    elif kind == 2:
        rod = with_plug(Rod(length, 0.05, stiff, 0.8 * stiff, radius=2e-3), 0.1 * length,
                        given.between(0.001, 0.02) * length)
    else:
        more['point_masses'] = ((rng.uniform(0.2, 0.9) * length, 0.01), (length, 0.005))
        rod = Rod(length, 0.05, (stiff, 3 * stiff), stiff, **more)
        options['point_loads'] = [PointLoad(0.3 * rng.normal(size=3) * length,
                                            s=rng.uniform(0.1, 1) * length)]
        if given.number % 8 == 3:
            options['point_loads'].append(PointLoad(moment=0.05 * stiff / length * rng.normal(
                size=3)))
    if rng.random() < 0.3:
        options['load'] = 0.2 * rng.normal(size=3)
    how = ({}, {'basis': 'local'}, {'accuracy': 1e-4 * length})[given.number // 4 % 3]
    return of_shape(DirectSimulator(rod, **how, **options).solve(given.anywhere()), rod)


def study(given):
    """Solve by the methods of the paper."""
    rod = Rod(1.0, 0.05, given.between(0.1, 2), given.between(0.1, 2))
    simplex = given.number % 4 == 3
    direct = DirectSimulator(
        rod, method='downhill_simplex' if simplex else 'dfp', n_elements=16,
        n_terms=1 if simplex else 3, strains=('components', 'paper')[given.number % 2])
    pose = given.turned((0, 0, 0), (0, given.rng.uniform(-1, 1), given.rng.uniform(-1, 1)))
    return of_shape(direct.solve(pose), rod, 1e3 if simplex else 100.0, estimate=False)


def tracked(given):
    """Follow a slow motion, with falls in some."""
    rod = given.rod((0.1, 300))
    direct = DirectSimulator(rod, **HOW[given.number % len(HOW)])
    turn = given.rng.uniform(0.3, 3.0) * given.direction()
    return of_shapes(direct.track(given.way(
        given.anywhere(), given.rng.normal(size=3), turn, 8)), rod)


def falling(given):
    """Turn a DLO over and back, so that it falls: benchmark C of the paper, and its kin."""
    rod = given.rod((2, 60), length=1.0)
    direct = DirectSimulator(rod, **HOW[given.number % len(HOW)])
    aside = 10 ** given.rng.uniform(-3, -1)
    start = given.turned((0, 0, 0), aside * given.rng.normal(size=3))
    side = (0, -1, 0) + aside * given.rng.normal(size=3)
    over = given.way(start, (0, 0, 0), given.rng.uniform(2.2, np.pi) * side, 9)
    return of_shapes(direct.track([start, *over, *over[-2::-1], start]), rod)


def neutral(given):
    """Solve without gravity, or straight up or down: shapes that follow from symmetry."""
    rod = Rod.circular(1.0, 1e-3, 8960.0, given.between(0.3, 3) * 110e9, 0.34)
    gravity = (0, 0, 0) if given.number % 2 else (0, 0, -9.81)
    up = (0, 0, 1.0 if given.number % 4 == 2 else -1.0)
    return of_shape(DirectSimulator(rod, gravity=gravity, **HOW[given.number % len(HOW)]).solve(
        given.along((0, 0, 1), up)), rod, 10.0)


def _ends(given, length, low, high):
    """Return poses of a gripper and of a far end, some part of the length apart."""
    way = np.array([1, *given.rng.uniform(-0.3, 0.3, 2)])
    away = length * given.rng.uniform(low, high) * way / np.linalg.norm(way)
    return (given.turned((0, 0, 0), given.rng.uniform(-0.8, 0.8, 3)),
            given.turned(away, given.rng.uniform(-0.8, 0.8, 3)))


def _held(given, low, high, load):
    rod = given.rod(load)
    grip = GRIPS[given.number % 4]
    how = HOW[given.number // 4 % 2] if given.number % 3 else {'accuracy': 1e-4 * rod.length}
    pinned = given.number % 5 == 4
    direct = DirectSimulator(rod, grip='pinned' if pinned else 'clamped', **how)
    return rod, direct, *_ends(given, rod.length, low, high), grip


def held(given):
    """Solve for a far end that is held in one of four ways, cold or after a small step."""
    rod, direct, gripper, end, grip = _held(given, 0.5, 0.95, (1, 3e3))
    shape = direct.solve(gripper, far_end=FarEnd(end, grip))
    if given.number % 2:
        moved = given.way(end, 0.01 * rod.length * given.direction(), 0.05 * given.direction(), 1)
        shape = direct.solve(gripper, shape, far_end=FarEnd(moved[0], grip))
    return of_shape(shape, rod)


def taut(given):
    """Solve for a far end so far away that the DLO is nearly taut."""
    rod, direct, gripper, end, grip = _held(given, 0.97, 0.9995, (10, 1e4))
    return of_shape(direct.solve(gripper, far_end=FarEnd(end, grip)), rod, 3.0)


def held_track(given):
    """Follow a slow motion of both ends."""
    rod, direct, gripper, end, grip = _held(given, 0.5, 0.9, (1, 1e3))
    shift = 0.1 * rod.length * given.direction()
    grippers = [gripper, *given.way(gripper, shift, 0.5 * given.direction(), 5)]
    ends = [end, *given.way(end, -0.3 * shift, 0.5 * given.direction(), 5)]
    return of_shapes(direct.track(grippers, far_ends=[FarEnd(one, grip) for one in ends]), rod)


def grasped(given):
    """Solve for a DLO that is grasped somewhere inside."""
    rod = given.rod((1, 300))
    direct = GraspedInside(rod, given.rng.uniform(0.1, 0.9) * rod.length,
                           **HOW[given.number % 3])
    pose = given.anywhere()
    shape = direct.solve(pose)
    if given.number % 2:
        shape = direct.solve(given.way(pose, np.zeros(3), 0.3 * given.direction(), 1)[0], shape)
    return of_shape(shape, rod)


def yielding_rod(given):
    """Return a Rod that yields when it is turned and bent as by `yielding`."""
    kind = given.number % 3
    if kind == 0:
        return Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, hardening=0.05,
                            yield_stress=given.between(20e6, 60e6))
    if kind == 1:
        return Rod.rectangular(0.8, 10e-3, 1e-3, 7800.0, 200e9, 0.25, hardening=0.1,
                               yield_stress=given.between(40e6, 120e6))
    stiff = given.between(0.1, 0.4)
    return Rod(1.0, 0.05, stiff, 0.7 * stiff, radius=1e-3, hardening=0.1,
               yield_curvature=0.3 * 0.25 / stiff, yield_torsion=2.0, section_model='round')


def yielding(given):
    """Turn a DLO that yields, there and back, some of them twice."""
    rod = yielding_rod(given)
    direct = DirectSimulator(rod, **HOW[given.number % 2 * 4])
    start = given.turned((0, 0, 0), (0, given.rng.uniform(-1.0, 0.5), 0))
    turn = given.rng.uniform(0.5, 2.5) * given.direction()
    there = given.way(start, (0, 0, 0), turn, 6)
    poses = [start, *there, *there[-2::-1], start] * (1 + given.number % 2)
    return of_shapes(direct.track(poses), rod, 3.0, estimate=given.number % 4 == 0)


def many(given):
    """Solve for many poses at once."""
    rod = given.rod((0.1, 100))
    floor = [Plane((0, 0, -0.5 * rod.length), (0, 0, 1))] * (given.number % 3 == 2)
    direct = DirectSimulator(rod, obstacles=floor, **HOW[given.number % 4])
    poses = [given.pose((0, 0, 0), given.rng.normal(size=4)) for _ in range(6)]
    shapes = solve_many(direct, poses)
    answer, scale = Answer(), Scale.of(rod)
    answer.say('verdicts', ''.join('c' if one else 'n' for one in shapes.converged))
    loose = np.clip(0.1 / max(np.abs(shapes.stability).min(), 1e-12), 1, 100)
    loose *= 10.0 if floor else 1.0
    answer.put('tips', shapes.positions[:, -1], 1e-7 * loose * scale.length)
    answer.put('energy', shapes.energy, 3e-7 * loose * scale.energy)
    answer.put('stability', shapes.stability, min(1e-3 * loose, 1e-2))
    return answer


def modes(given):
    """Return vibrations: of a shape, of a held one, along a way."""
    rod = given.rod((0.3, 100), damping=(0.1, 1e-3))
    direct = DirectSimulator(rod, **HOW[given.number % 4])
    start, answer = given.anywhere(), Answer()
    if given.number % 3 == 0:
        away = start.compose(Pose((0.8 * rod.length, 0, 0), (0, 0, 0, 1)))
        found = direct.solve(start, far_end=FarEnd(away)).modes(3)
    elif given.number % 3 == 1:
        found = direct.solve(start).modes(3)
    else:
        found = modes_along(direct.track([start, *given.way(
            start, np.zeros(3), 0.2 * given.direction(), 3)]), 3)[-1]
    size = np.abs(found.frequencies).max()
    answer.put('frequencies', found.frequencies, 1e-5 * size)
    answer.put('damping', found.damping_ratios, 1e-5 * np.abs(found.damping_ratios).max())
    effective = (found.participation**2)[:, :3].sum(axis=1)
    answer.put('masses', effective, 1e-4 * effective.max())
    return answer


class _Witness:
    """A penalty that keeps the sensitivity which it is shown first."""

    def __init__(self, s):
        self.s, self.seen = s, None

    def residuals(self, shape):
        return shape.at(self.s).position

    def slopes(self, shape, sensitivity):
        if self.seen is None:
            self.seen = sensitivity.at(self.s)
        return sensitivity.at(self.s)[3:]


def sensitivity(given):
    """Return the derivatives of a place by the gripper, as penalties are given them."""
    rod = given.rod((0.3, 100))
    witness = _Witness(given.rng.uniform(0.3, 1) * rod.length)
    pose = given.anywhere()
    minimize_penalty(DirectSimulator(rod, **HOW[given.number % 4]), witness, pose,
                     max_iterations=1)
    answer = Answer()
    seen = witness.seen / np.repeat([1.0, rod.length], 3)[:, None] * np.repeat([1.0, rod.length], 3)
    answer.put('derivatives', seen, 1e-5 * max(1.0, np.abs(seen).max()))
    return answer


def _seen(given, rod, how):
    """Return Observations of a DLO in three grippers, exact but for 1e-4 of the length."""
    direct, seen = DirectSimulator(rod, **how), []
    places = np.array([0.3, 0.6, 0.8, 1.0]) * rod.length
    for _ in range(3):
        pose = given.turned((0, 0, 0), given.rng.normal(size=3))
        points = direct.solve(pose).positions_at(places)
        noise = 1e-4 * rod.length * given.rng.normal(size=points.shape)
        seen.append(Observation(pose, points + noise, places))
    return seen


def fitted(given):
    """Fit stiffness and natural curvature to what is seen of a DLO."""
    rod = Rod(1.0, 0.05, (given.between(0.05, 0.5),) * 2, given.between(0.05, 0.5),
              natural_curvature=0.2 * given.rng.normal(size=2))
    how = HOW[given.number % 2]
    guess = replace(rod, bending_stiffness=tuple(1.2 * one for one in rod.bending_stiffness),
                    natural_curvature=(0.0, 0.0))
    found = fit_rod(guess, _seen(given, rod, how), ('bending_stiffness', 'natural_curvature'),
                    **how)
    answer = Answer()
    answer.say('converged', found.converged)
    answer.put('values', np.concatenate([np.ravel(one) for one in found.values.values()]), 1e-4)
    answer.put('deviations', np.concatenate([np.ravel(one) for one in found.deviations.values()]),
               1e-5)
    answer.put('misfit', found.misfit, 1e-7)
    return answer


def observed(given):
    """Estimate a DLO's properties on the way, look by look."""
    rod = Rod(1.0, 0.05, given.between(0.05, 0.5), given.between(0.05, 0.5))
    how = HOW[given.number % 2]
    stiffer = replace(rod, bending_stiffness=tuple(1.03 * one for one in rod.bending_stiffness))
    observer = Observer(DirectSimulator(rod, **how), Uncertainty(
        0.05, natural_curvature=0.05, gripper_position=1e-3, gripper_rotation=5e-3), cutout=1e-3)
    estimate = observer.begin()
    for look in _seen(given, stiffer, how):
        estimate = observer.update(estimate, look, noise=3e-4)
    answer = Answer()
    answer.put('mean', estimate.mean, 1e-5)
    answer.put('spread', np.sqrt(np.diag(estimate.covariance)), 1e-5)
    return answer
