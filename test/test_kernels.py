# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Each kernel is compiled for one set of types: another one would compile at run time.

But for the kinds of DLO that there are: one that hangs freely, one that moves so, and all others.
"""

import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba import types

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Observer,
    Plane,
    Pose,
    Rod,
    Sheet,
    Uncertainty,
    Workspace,
    fit_rod,
    solve_many,
)
from dlo_planner.direct.accuracy import discretization_errors
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.gap import closest_point_in_element
from dlo_planner.energy.plastic import return_map
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.scene import signed_distance
from dlo_planner.geometry.basis import equidistribute
from dlo_planner.geometry.kinematics import frame_along, nearest_place, points_inside
from dlo_planner.identify import Observation, correct, residuals
from dlo_planner.identify.residuals import nearest
from dlo_planner.inverse.equilibria import integrate_from_tip
from dlo_planner.inverse.waypoint_newton import follow_goals, solve_goals
from dlo_planner.kernels import files
from dlo_planner.kernels.dispatcher import key_of
from dlo_planner.minimize.active_set import update_active_set
from dlo_planner.minimize.contact_solver import predictor_corrector, solve_contact
from dlo_planner.minimize.contact_table import kkt_residual, touching, update_friction
from dlo_planner.minimize.convergence import gradient_noise
from dlo_planner.minimize.newton import follow_homotopy, newton_descent
from dlo_planner.minimize.response import (
    gripper_answers,
    hanging_answers,
    hanging_slopes,
    node_twists,
    strain_answers,
    twists_inside,
)
from dlo_planner.minimize.semismooth import semismooth_newton
from dlo_planner.minimize.solve import follow_step, solve_free, solve_step
from dlo_planner.penalties import PositionAt, Through
from dlo_planner.plan import clearance, swept, workspace
from dlo_planner.plan.goal_rows import fill_residuals, fill_rows
from dlo_planner.uncertainty import parameters

_KINDS = 3
KERNELS = [newton_descent, unknowns_of, solve_goals, integrate_from_tip, frame_along,
           sweeps_through, evaluate, closest_point_in_element, nearest, signed_distance, return_map,
           update_active_set, update_friction, follow_homotopy, gradient_noise, touching,
           kkt_residual, semismooth_newton, gripper_answers, clearance.element_rooms,
           swept._exceeded, workspace.distances_from, strain_answers, parameters._moved_points,
           residuals._points_at, nearest_place, follow_goals, solve_free, solve_contact,
           predictor_corrector, follow_step, discretization_errors, equidistribute, node_twists,
           twists_inside, fill_residuals, fill_rows, hanging_answers, hanging_slopes,
           parameters.moved_points_of, points_inside]


def use_everything():
    """Call all that calls kernels, in all the ways that may differ in types."""
    rod = Rod(1.0, 0.1, (1.0, 2.0), 0.7, natural_curvature=(0.1, 0.2))
    start = Pose.looking_along((0, 0, 0), (1, 0.2, 0))
    goal = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    for options in ({}, {'basis': 'local'}, {'accuracy': 1e-4}, {'gravity': [0, 0, -1]}):
        direct = DirectSimulator(rod, **options)
        shape = direct.solve(start)
        direct.solve(start, shape.moved((1, 2, 3)))
        direct.track([start, goal.pose])
        direct.simulate([start, start], 0.01)
        assert shape.error_estimate > 0
        shape.at(np.float32(0.5))
        again = pickle.loads(pickle.dumps(shape))
        again.at(0.5)
        direct.solve(start, again)
        direct.solve(start, shape.resample(20)).moved((1, 0, 0)).at(0.5)
        PositionAt(0.5, (0, 0, 0)).slopes(shape, Sensitivity(shape))
        for one in (shape, again, shape.resample(20), shape.moved((1, 0, 0))):
            Through([0.5, 0, -0.3], 0).passage(one)
        for others in ([rod, rod], [rod, replace(rod, length=0.9)]):
            one, _ = solve_many(direct, start, rods=others)
            Through((0.5, 0, -0.3), 0.1).passage(one)
        Sensitivity(shape).moved(np.full(6, 1e-3)).at(0.5)
        assert shape.modes(2).error_estimate.max() < 1
        for first in (None, start):
            InverseSimulator(direct).thread(goal, start=first, depths=[0, 0.5])
        fit_rod(rod, [Observation(start, shape.positions[::9])], **options)
    plan = InverseSimulator(DirectSimulator(rod)).thread(goal, depths=[0, 0.5])
    for options in ({}, {'accuracy': 1e-4}):
        InverseSimulator(DirectSimulator(rod, **options)).thread_two(
            goal, CutOut(Pose.looking_along((0.3, 0, 0.97), (1, 0, 0))), depths=[0, 0.2, 0.4])
        InverseSimulator(DirectSimulator(rod, **options)).thread_sequence(
            [CutOut(Pose.looking_along((x, 0, 1), (1, 0, 0))) for x in (0, 0.2, 0.4)],
            depths=[0, 0.1])
    spread = Uncertainty(0.05, 0.05, 0.05, 1e-3, 0.05, 1e-3, 1e-3, 0.05)
    for options in ({}, {'basis': 'local', 'n_elements': 48}):
        observer = Observer(DirectSimulator(rod, **options), spread, bias=1e-3)
        estimate = observer.begin()
        for s in (None, shape.s[::9]):
            estimate = observer.update(estimate, Observation(start, shape.positions[::9], s))
        correct(estimate, plan)
    touching = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, yield_curvature=0.2, hardening=0.1)
    hole = CutOut(Pose.looking_along((0.4, 0, 0), (1, 0, 0)), radius=0.2)
    direct = DirectSimulator(touching, obstacles=[Plane((0, 0, -0.2), (0, 0, 1), 0.2),
                                                  Sheet.around(hole)])
    shapes = direct.track([Pose.identity(), Pose((0, 0, -0.05), (0, 0, 0, 1))])
    direct.simulate([Pose.identity()] * 2, 0.01, shapes[0])
    for simulator in (direct, DirectSimulator(rod, grip='pinned'), DirectSimulator(rod)):
        for end in ((0.8, 0, 0), Pose((0.8, 0, 0), (0, 0, 0, 1))):
            held = simulator.solve(Pose.identity(), far_end=end)
            assert simulator.solve(Pose.identity(), held, far_end=end).error_estimate > 0
            if simulator is not direct:  # which has friction
                assert held.modes(2).error_estimate.max() < 1
    Sensitivity(held)
    cell = Workspace(keep_out=[Plane((0, 0, -9), (0, 0, 1))])
    for gripper in (start, Pose.from_matrix(start.matrix)):
        cell.min_margin(gripper)
    for simulator in (DirectSimulator(touching), direct):
        InverseSimulator(simulator, workspace=cell).thread(
            CutOut(Pose.looking_along((9, 0, 1), (1, 0, 0)), radius=0.2), depths=[0, 0.5])


def absent(kind, name=''):
    """Yield the names of what is None in a type, at any depth of its fields."""
    if isinstance(kind, types.NoneType):
        yield name
    for field, inner in getattr(kind, 'field_dict', {}).items():
        yield from absent(inner, f'{name}.{field}')


def compiled_for(kernel):
    """Return how many types a kernel was compiled for, and how many kinds of DLO those are."""
    signatures = {*kernel.signatures, *kernel.for_python.signatures}
    kinds = {tuple(one for k, kind in enumerate(signature) for one in absent(kind, str(k)))
             for signature in signatures}
    return len(signatures), len(kinds)


@pytest.fixture(scope='module')
def signatures():
    """Return `compiled_for` of each kernel, in a process where nothing else ran."""
    code = ('import json, test_kernels as t; t.use_everything(); '
            'print(json.dumps([t.compiled_for(kernel) for kernel in t.KERNELS]))')
    paths = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True,
                          env={**os.environ, 'PYTHONPATH': os.pathsep.join(paths)})
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.sweep
@pytest.mark.parametrize('index', range(len(KERNELS)), ids=lambda k: KERNELS[k].__name__)
def test_one_signature_for_each_kind_of_dlo(index, signatures):
    number, kinds = signatures[index]
    assert 0 < number == kinds <= _KINDS


def test_a_dlo_that_hangs_freely_compiles_nothing_of_contact_ends_or_plasticity():
    assert DirectSimulator(Rod(1.0, 0.1, 1.0, 0.7)).solve(Pose.identity()).converged
    free = next(kinds for kinds in solve_step.for_python.signatures  # whatever others have compiled
                if all(f"('{term}', none)" in str(kinds[0])
                       for term in ('plastic', 'hold', 'contact')))
    waiting, code = [(solve_step.for_python, free)], b''
    while waiting:  # all that it consists of
        kernel, kinds = waiting.pop()
        called, (library, *_) = next(files.kept(key_of(kernel, kinds)), ((), (0,)))
        if not library:
            pytest.skip('no folder in which compiled kernels are kept')
        code += library[2][0]
        waiting += [(one.kernel, one.kinds) for one in called]
    assert all(name in code for name in (b'fill_blocks', b'factorize_blocks', b'lowest_mode'))
    assert not any(name in code for name in (
        b'add_contacts', b'sweeps_through', b'add_plastic', b'add_hold', b'complemented'))


SHARED = """
import json
from dlo_planner import DirectSimulator, Plane, Pose, Rod
from dlo_planner.direct.integrator import integrate
from dlo_planner.kernels import files
from dlo_planner.kernels.dispatcher import key_of
from dlo_planner.minimize.solve import placed_step, solve_step

rod = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, yield_curvature=0.2, hardening=0.1)
direct = DirectSimulator(rod, obstacles=[Plane((0, 0, -0.2), (0, 0, 1), 0.2)])
shape = direct.solve(Pose.identity())
direct.simulate([Pose.identity()] * 2, 0.01, shape)
waiting = [(kernel.for_python, kinds) for kernel in (placed_step, solve_step, integrate)
           for kinds in kernel.for_python.signatures if '.ContactType(' in str(kinds)]
found = {}
while waiting:  # all that these consist of
    kernel, kinds = waiting.pop()
    known = found.setdefault(key_of(kernel, kinds).kernel, set())
    if kinds not in known:
        known.add(kinds)
        called, _ = next(files.kept(key_of(kernel, kinds)), ((), ()))
        waiting += [(one.kernel, one.kinds) for one in called]
print(json.dumps({name: sum('.ContactType(' in str(kinds) for kinds in each)
                  for name, each in found.items()}))
"""


def test_statics_and_motion_in_contact_share_their_kernels():
    # (in a process of its own: other tests call them with other kinds of what they take)
    done = subprocess.run([sys.executable, '-c', SHARED], cwd=ROOT, text=True, capture_output=True,
                          check=True, env={**os.environ, 'NUMBA_DISABLE_JIT': '0'})
    found = json.loads(done.stdout.splitlines()[-1])
    if not found:
        pytest.skip('no folder in which compiled kernels are kept')
    assert found['dlo_planner.minimize.contact_solver.solve_contact'] == 1
    twice = {name.rpartition('.')[2] for name, count in found.items() if count > 1}
    # the first two copy what a Memory has left, which statics may not write; the third may watch,
    # the last one has springs of contacts to add, or none
    assert twice <= {'placed', '_touching', 'solve_step', '_factorize_without_border'}


# ---- what is compiled ahead: all kernels ----------------------------------------------------


ROOT = Path(__file__).parent.parent
USED = """
import json
from dlo_planner import exercises
from dlo_planner.kernels import dispatcher
from dlo_planner.kernels.fingerprint import dependencies
for exercise in exercises.ALL:
    exercise()
kernels = {f: k for f, k in dispatcher.KERNELS.items() if f.__module__.startswith('dlo_planner.')}
kinds = {f.__qualname__: len(k.signatures) for f, k in kernels.items()
         if f.__module__ == 'dlo_planner.minimize.lanczos'}
reached = {f for k in kernels.values() if k.signatures for f in dependencies(k)}
print(json.dumps([len(kernels), [f'{f.__module__}.{f.__qualname__}' for f in kernels
                                 if f not in reached], kinds]))
"""


@pytest.mark.sweep
def test_the_exercises_use_every_kernel():
    done = subprocess.run([sys.executable, '-c', USED], cwd=ROOT, text=True, capture_output=True,
                          check=True, env={**os.environ, 'NUMBA_DISABLE_JIT': '0'})
    number, left_out, kinds = json.loads(done.stdout.splitlines()[-1])
    assert number > 100 and not left_out
    assert kinds['lowest_mode'] == 3  # as CONTRIBUTING.md says
