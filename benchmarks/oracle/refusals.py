# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cases that are refused: which error, and which argument and number it names."""

import numpy as np

from benchmarks.oracle.answers import Answer
from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    DirectSimulator,
    FarEnd,
    HoldContact,
    Insert,
    InverseSimulator,
    Limits,
    Minimize,
    Plane,
    PointLoad,
    Pose,
    Rod,
    Sheet,
    SlideContact,
    Sphere,
    Thread,
    ThreadSequence,
    Trajectory,
    Uncertainty,
    Workspace,
    replay,
    solve_many,
)
from dlo_planner.penalties import PositionAt, minimize_penalty
from dlo_planner.rods import GraspedInside, with_plug
from dlo_planner.tasks import Requirements

WIRE = {'length': 1.0, 'mass_per_length': 0.05, 'bending_stiffness': 0.5,
        'torsional_stiffness': 0.4, 'radius': 2e-3}
NOT_POSITIVE = -1.0, 0.0, np.nan, np.inf, 'long', None
NEGATIVE = -1.0, np.nan, np.inf, 'heavy'
NO_VECTOR = (0, 0), (np.nan, 0, 1), 'up', 3.0
HERE = Pose.identity()
BALL = Sphere((0.5, 0, -1.0), 0.2)


def wire(**more):
    """Return the Rod of these cases."""
    return Rod(**WIRE | more)


def direct(**more):
    """Return a DirectSimulator of it."""
    return DirectSimulator(wire(), **more)


def hole(direction=(1, 0, 0), **size):
    """Return a CutOut at 1 m."""
    return CutOut(Pose.looking_along((0, 0, 1), direction), **size)


def _each(make, name, values):
    """Return functions without arguments that call `make` with each of the values."""
    return [lambda value=value: make(**{name: value}) for value in values]


def _rods():
    for name in ('length', 'bending_stiffness', 'torsional_stiffness', 'radius'):
        yield from _each(wire, name, NOT_POSITIVE[:5])
    for name in ('mass_per_length', 'tip_mass', 'damping'):
        yield from _each(wire, name, NEGATIVE)
    yield from _each(wire, 'natural_curvature', ((1,), (1, 2, 3), 'bent', (np.nan, 0)))
    yield from _each(wire, 'natural_twist', (np.nan, 'twisted'))
    yield from _each(wire, 'yield_curvature', (0.0, -1.0, (1, 2, 3), 'soft'))
    yield from _each(wire, 'hardening', (1.0, -0.1, np.nan))
    yield from _each(wire, 'section_model', ('oval', 'fibers', 3))
    yield from _each(wire, 'point_masses', (3, ((2.0, 0.1),), ((0.5, -0.1),)))
    yield from _each(wire, 'mass_per_length', (((0, 1), (0.5, 2)), ((1, 1), (0, 2)), ()))
    yield from _each(wire, 'bending_stiffness', ((1, -1), (1, 2, 3), lambda s: -s))
    yield from _each(wire, 'max_bend_curvature', (-1.0, 'sharp'))
    yield from _each(wire, 'nodes', ((2.0,), (-0.1,), 'two'))
    sizes = {'length': 1.0, 'diameter': 1e-3, 'density': 1e3, 'youngs_modulus': 1e9,
             'poisson_ratio': 0.3}
    for name in sizes:
        yield from _each(lambda **more: Rod.circular(**sizes | more), name, (-1.0, np.nan, 'x'))
    yield lambda: Rod.circular(**sizes | {'poisson_ratio': 0.6})
    yield lambda: Rod.tube(1.0, 1e-3, 1e-3, 1e3, 1e9, 0.3)
    yield lambda: Rod.rectangular(1.0, 1e-3, 0.0, 1e3, 1e9, 0.3)
    yield lambda: with_plug(wire(), -0.1, 0.01)
    yield lambda: with_plug(wire(), 0.1, -0.01)
    yield lambda: with_plug(wire(), 0.1, 0.01, center=0.2)


def _things():
    for values in (((0, 0), (0, 0, 0, 1)), ((0, 0, 0), (0, 0, 0, 0)), ('here', (0, 0, 0, 1)),
                   ((0, 0, np.nan), (0, 0, 0, 1)), ((0, 0, 0), (0, 0, 1))):
        yield lambda values=values: Pose(*values)
    yield lambda: Pose.looking_along((0, 0, 0), (0, 0, 0))
    yield lambda: Pose.from_matrix(np.diag([1, 1, -1, 1.0]))
    yield lambda: Pose.from_rotation((0, 0, 0), 2 * np.eye(3))
    yield lambda: Plane((0, 0, 0), (0, 0, 0))
    for value in NO_VECTOR:
        yield lambda value=value: Plane(value, (0, 0, 1))
        yield lambda value=value: Sphere(value, 0.1)
    for value in (0.0, -1.0, np.nan, 'wide'):
        yield lambda value=value: Sphere((0, 0, 0), value)
        yield lambda value=value: Capsule((0, 0, 0), (1, 0, 0), value)
        yield lambda value=value: Cylinder((0, 0, 0), (1, 0, 0), value)
        yield lambda value=value: Box(HERE, (1, value, 1))
        yield lambda value=value: Sheet(HERE, value, 1.0)
        yield lambda value=value: CutOut(HERE, radius=value)
    yield lambda: Capsule((0, 0, 0), (0, 0, 0), 0.1)
    yield lambda: Plane((0, 0, 0), (0, 0, 1), -0.1)
    yield lambda: Sheet(HERE, 0.1, 0.1, cutouts=[CutOut(HERE, radius=0.2)])
    yield lambda: Sheet(HERE, 1.0, 1.0, cutouts=[CutOut(HERE)])
    yield lambda: Sheet(HERE, 1.0, 1.0, cutouts=[CutOut(Pose((0.1, 0, 0), (0, 0, 0, 1)), 0.1)])
    yield lambda: CutOut(HERE, 0.1, 0.1, 0.1)
    yield lambda: CutOut(HERE, width=0.1)
    yield lambda: FarEnd(HERE, 'glued')
    yield lambda: FarEnd((0, 0, 1))
    yield lambda: PointLoad((0, 0))
    yield lambda: PointLoad((0, 0, 1), s=-0.1)
    yield lambda: Limits(linear_speed=0.0)
    yield lambda: Workspace((0, 0, 0), (1, 1, 0))
    yield lambda: Requirements(stability=2.0)
    yield lambda: Uncertainty(length=-1.0)


def _simulators():
    for name, values in (('n_elements', (1, 0, 2.5, 'many', 10**6)), ('n_terms', (0, 2.5, 1000)),
                         ('basis', ('sine', 3)), ('method', ('guess',)), ('strains', ('odd',)),
                         ('accuracy', (0.0, -1.0, np.nan, 1e-12)), ('gravity', NO_VECTOR),
                         ('load', ((0, 1), 'wind')), ('obstacles', (3, [HERE], 'floor')),
                         ('point_loads', (3, [HERE], [PointLoad((0, 0, 1), s=2.0)])),
                         ('grip', ('loose',))):
        yield from _each(direct, name, values)
    yield lambda: direct(accuracy=1e-4, n_elements=32)
    yield lambda: direct(accuracy=1e-4, method='dfp')
    yield lambda: direct(method='dfp', obstacles=[BALL])
    yield lambda: direct(strains='paper')
    yield lambda: direct(method='dfp').solve(HERE, far_end=(0.5, 0, 0))
    yield lambda: direct().solve('here')
    yield lambda: direct().solve(HERE, 'straight')
    yield lambda: direct().solve(HERE, far_end=(0, 0))
    yield lambda: direct().solve(HERE, far_end=(50.0, 0, 0))
    yield lambda: direct().solve(HERE, DirectSimulator(wire(length=0.5)).solve(HERE))
    yield lambda: direct().track([HERE, 3])
    yield lambda: direct().track(3)
    yield lambda: direct().track([HERE, HERE], far_ends=[(0.5, 0, 0)])
    yield lambda: direct().simulate([HERE, HERE], 0.0)
    yield lambda: direct().simulate([], 0.1)
    yield lambda: direct().simulate([HERE, HERE], 0.1, tolerance=-1.0)
    yield lambda: direct().simulate([HERE, HERE], 0.1, integrator='euler')
    yield lambda: direct().simulate([HERE, HERE], 0.1, velocity=np.zeros((3, 3)))
    yield lambda: direct().simulate([HERE] * 2, 0.1, far_ends=[(0.5, 0, 0), HERE])
    yield lambda: direct().solve(HERE).at(2.0)
    yield lambda: direct().solve(HERE).positions_at([-0.5])
    yield lambda: direct().solve(HERE).modes(0)
    yield lambda: direct().solve(HERE).resample(0)
    yield lambda: direct(point_loads=[PointLoad(moment=(0, 0.01, 0))]).solve(HERE).modes()
    yield lambda: GraspedInside(wire(), 1.5)
    yield lambda: GraspedInside(wire(), 0.5, grip='pinned')
    yield lambda: GraspedInside(wire(), 0.5).solve(HERE, direct().solve(HERE))
    yield lambda: solve_many(direct(), [HERE, 3])
    yield lambda: direct().with_set(GraspedInside(wire(), 0.5).solve(HERE))


def _plans():
    inverse = InverseSimulator(direct(basis='local', n_elements=32))
    over = InverseSimulator(direct(basis='local', n_elements=32, obstacles=[BALL]))
    yield lambda: InverseSimulator(direct(grip='pinned'))
    yield lambda: InverseSimulator(direct(method='dfp'))
    yield lambda: InverseSimulator(wire())
    yield lambda: inverse.plan('thread')
    for depths in ([0.5, 0.2], [-0.1], [2.0], 'deep', []):
        yield lambda depths=depths: inverse.thread(hole(), depths=depths)
    yield lambda: Thread(HERE)
    yield lambda: Thread(hole(), method='guess')
    yield lambda: Thread(hole(), gripper_clearance=-1.0)
    yield lambda: inverse.thread(hole(), linear_speed=0.0)
    yield lambda: inverse.thread(hole(), start='here')
    yield lambda: ThreadSequence([])
    yield lambda: ThreadSequence([hole(), hole()], weights=[1.0])
    yield lambda: inverse.plan(Insert(hole(), [0.995]))
    yield lambda: Insert(hole(), friction=-0.1)
    yield lambda: inverse.plan(HoldContact(HERE, 0.5))
    yield lambda: HoldContact(HERE, -0.5)
    yield lambda: HoldContact(HERE, 0.5, 'most_fun')
    yield lambda: over.plan(HoldContact(HERE, 0.5))
    yield lambda: over.plan(HoldContact(HERE, 2.0))
    yield lambda: over.plan(HoldContact(Pose((0.5, 0, -0.8), (0, 0, 0, 1)), 0.5, 'least_motion'))
    yield lambda: SlideContact(HERE, [])
    yield lambda: SlideContact(HERE, [0.5], mode='odd')
    yield lambda: Minimize([])
    yield lambda: PositionAt(-1.0, (0, 0, 0))
    yield lambda: inverse.plan(Minimize(PositionAt(2.0, (0, 0, 0))), start=HERE)
    yield lambda: inverse.plan(Minimize(PositionAt(1.0, (0, 0, 0))))
    yield lambda: minimize_penalty(direct(), PositionAt(1.0, (0, 0, 0)), HERE, max_iterations=0)
    yield lambda: inverse.plan(Thread(hole()), initial='straight')
    yield lambda: inverse.plan(Insert(hole()), initial=direct().solve(HERE))
    yield lambda: Trajectory('plan')
    yield lambda: replay(direct(), 'plan')
    yield lambda: inverse.thread(hole((0, 0, 1)), depths=[0, 0.5])   # not to be held up
    yield lambda: InverseSimulator(direct(), workspace=Workspace((5, 5, 5))).thread(
        hole((1, 0, -1)), depths=[0, 0.3])


CASES = [*_rods(), *_things(), *_simulators(), *_plans()]
COUNT = len(CASES)


def refused(given):
    """Return the Answer of what ought to be refused; where it is not, that is said."""
    CASES[given.number]()
    answer = Answer()
    answer.say('refused', 'no')
    return answer
