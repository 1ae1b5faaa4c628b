# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Small jobs that, together, use every kernel: what is compiled ahead is what they need.

test_kernels.py watches that no kernel is left out.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from dlo_planner.direct.equilibrium import corrected_by, past_of
from dlo_planner.direct.self_passage import passed_between
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError
from dlo_planner.execute.correction_checks import retargeted
from dlo_planner.execute.limiter import frames_of, velocities
from dlo_planner.execute.loop_motions import LoopTask, way_back, way_in, way_to_standoff
from dlo_planner.geometry.self_passage import first_passage
from dlo_planner.identify.correction import correct
from dlo_planner.identify.fit import fit_rod
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.observer import Observer
from dlo_planner.inverse.equilibria import hanging_shapes
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.obstacles import Mesh, Plane, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import PointLoad
from dlo_planner.parallel.batch import solve_many
from dlo_planner.plan.goals import AwayFrom, InHole, Through
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.uncertainty.parameters import Uncertainty
from dlo_planner.verify.replay import replay

_THIN = Rod(1.0, 0.01, 1.0, 1.0, radius=1e-3)
_ROD = Rod(1.0, 0.1, (1.0, 2.0), 0.7, natural_curvature=(0.1, 0.2))
_YIELDING = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, yield_curvature=0.2, hardening=0.1)
_LEVEL = Pose((0, 0, 0), (0, 0, 0, 1))
_TETRAHEDRON = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
_TILTED = Pose.looking_along((0, 0, 0), (1, 0.2, 0))
_OPENING = CutOut(Pose.looking_along((0.4, 0, 0), (1, 0, 0)), radius=0.2)


def _hanging() -> Iterator[tuple[DirectSimulator, Shape]]:
    """Yield a simulator of each kind, and a shape."""
    every: tuple[dict[str, Any], ...] = {}, {'basis': 'local', 'accuracy': 1e-6}
    for options in every:
        direct = DirectSimulator(_ROD, **options)
        yield direct, direct.solve(_LEVEL, direct.solve(_TILTED))


def shapes() -> None:
    """Solve, with what a Shape tells."""
    for _, shape in _hanging():
        assert shape.error_estimate > 0
        shape.at(0.5)
        Sensitivity(shape).moved([1e-3] * 6)
        Sensitivity(shape).at(0.5)
        Through(np.array([0.5, 0, -0.3])).residuals(shape)


def motions() -> None:
    """Vibrate, simulate and track."""
    for direct, shape in _hanging():
        assert shape.modes(2).error_estimate.max() < 1
        assert direct.simulate([_LEVEL, _TILTED], 0.01).shapes[-1].stability > 0
        direct.track([_LEVEL, Pose((0, 0, 0), (0, 0, 0.5, 0.8))])


def many() -> None:
    """Solve many at once, in all ways to hang, and with a load that is none of gravity's."""
    assert hanging_shapes(DirectSimulator(_ROD).surroundings, np.linspace(0, 1, 9)) is not None
    for direct, _ in _hanging():
        assert solve_many(direct, [_LEVEL, _TILTED]).converged.all()
        assert solve_many(direct, _LEVEL, rods=[_ROD, _ROD]).converged.all()
    turned = PointLoad(moment=(0.0, 0.0, 1e-3))
    assert DirectSimulator(_ROD, point_loads=[turned]).solve(_LEVEL).converged


# What a node does when it starts: first shapes before it is active, the others beside its work.


def first_shapes(direct: DirectSimulator) -> None:
    """Use the kernels by which a node answers gripper poses."""
    with suppress(DloPlannerError):
        shape = direct.track([_LEVEL, Pose.looking_along((0, 0, 0), (1, 0, 0.1))])[-1]
        assert np.isfinite(shape.error_estimate) and np.isfinite(shape.gripper_wrench).all()


def answers() -> None:
    """Use every kernel that an answer of the node may need."""
    rod = _THIN
    floor = Plane((0, 0, -0.001), (0, 0, 1))
    level = Pose((0, 0, 0), (0, 0, 0, 1))
    holes = [_hole(x) for x in (0.0, 0.2)]
    for basis in ('local', 'chebyshev'):
        direct = DirectSimulator(rod, basis=basis, n_elements=16, n_terms=4)
        shape = direct.track([level, Pose.looking_along((0, 0, 0), (1, 0, 0.1))])[-1]
        _ = shape.error_estimate
        Workspace(keep_out=[floor]).min_margin(level)
        free = InverseSimulator(direct)
        free.approach(holes[0], free.thread(holes[0], depths=[0.0, 0.1]),
                      Pose((-1.5, 0, 0), (0, 0, 0, 1)), standoff=0.1)
        free.thread_two(*holes, depths=[0.0, 0.3])
        free.insert(holes[0], depths=[0.0, 0.1], friction=0.1)
        lying = DirectSimulator(rod, basis=basis, n_elements=16, n_terms=4, obstacles=[floor])
        lying.solve(level, lying.solve(level))
    yielding = Rod(1.0, 0.01, 1.0, 1.0, yield_curvature=0.01, hardening=0.5)
    DirectSimulator(yielding, n_elements=16, n_terms=4).solve(level)
    soft = Rod(1.0, 0.05, 0.03, 0.02, radius=2e-3)  # which passes obliquely
    InverseSimulator(DirectSimulator(soft)).thread(replace(holes[0], radius=0.05))


def proofs() -> None:
    """Use every kernel that a proof may need."""
    for basis in ('local', 'chebyshev'):
        direct = DirectSimulator(_THIN, basis=basis, n_elements=16, n_terms=4)
        plan = InverseSimulator(direct).thread(_hole(0.0), depths=[0.0, 0.1])
        replay(direct, plan, limits=Limits())


def looks() -> None:
    """Use every kernel that a look at the DLO may need, at rest or in motion."""
    for basis in ('local', 'chebyshev'):
        direct = DirectSimulator(_THIN, basis=basis, n_elements=16, n_terms=4)
        plan = InverseSimulator(direct).thread(_hole(0.0), depths=[0.0, 0.1])
        observer = Observer(direct, Uncertainty(0.05, 0.05, 0.05, natural_curvature=0.1))
        seen = plan.shapes[0]
        estimate = observer.update(observer.begin(), Observation(seen.gripper, seen.positions))
        estimate.miss(plan, [0, 1])
        plan.shapes[-1].modes(1)


def closed_loop() -> None:
    """Use the kernels that a plan of a closed loop may need, or a correction."""
    direct = DirectSimulator(_THIN, n_elements=16, n_terms=4)
    task = LoopTask(InverseSimulator(direct), Thread(_hole(0.0), [0.0, 0.1]), 0.1)
    here = Pose((-1.2, 0, 0), (0, 0, 0, 1))
    observer = Observer(direct, Uncertainty(0.05, 0.05, 0.05, natural_curvature=0.1))
    estimate = observer.update(observer.begin(), Observation(here, direct.solve(here).positions))
    way_to_standoff(task, estimate, here)
    entry = way_in(task, estimate, here, np.inf, 0.5)
    assert entry.motion is not None  # any bound will do
    way = entry.motion.corrected_trajectory
    retargeted(task.inverse, estimate, entry.commanded, way, 0.0,
               way.reached(entry.whole.times[-len(entry.commanded):]), None, np.inf, 0.5)
    way_back(task, estimate, way.poses(way.duration * np.array([0.1, 0.05, 0.0])),
             entry.whole.shapes[0])
    velocities(*frames_of([here, here]), 1.0)


def _hole(x: float) -> CutOut:
    return CutOut(Pose.looking_along((x, 0, 0), (1, 0, 0)), radius=0.1)


def _among_obstacles() -> DirectSimulator:
    """Return a DLO that yields, over a plane and beside a sheet with a hole."""
    return DirectSimulator(_YIELDING, obstacles=[Plane((0, 0, -0.2), (0, 0, 1), 0.2),
                                                 Sheet.around(_OPENING)])


def touching() -> None:
    """Solve among obstacles, with yield: half of all that there is to compile."""
    _among_obstacles().track([_LEVEL, Pose((0, 0, -0.05), (0, 0, 0, 1))])


def moved_in_contact() -> None:
    """Move among obstacles, with yield; hold the far end there."""
    direct = _among_obstacles()
    shapes = direct.track([_LEVEL, Pose((0, 0, -0.05), (0, 0, 0, 1))])
    direct.simulate([_LEVEL] * 2, 0.01, shapes[0])
    Sensitivity(shapes[-1])
    assert shapes[-1].self_distance == np.inf
    direct.solve(_LEVEL, far_end=(0.8, 0, 0))
    AwayFrom((Plane((0, 0, -0.2), (0, 0, 1)),), 0.1).residuals(shapes[0])
    InHole(_OPENING, 0.1).residuals(shapes[0])


def planned_among_obstacles() -> None:
    """Plan among obstacles, and lie on a mesh."""
    cell = Workspace(keep_out=[Plane((0, 0, -9), (0, 0, 1))])
    for simulator in (DirectSimulator(_YIELDING), _among_obstacles()):
        InverseSimulator(simulator, workspace=cell).thread(
            CutOut(Pose.looking_along((9, 0, 1), (1, 0, 0)), radius=0.2), depths=[0, 0.5])
    for rod in (_ROD, Rod(1.0, 0.1, 0.01, 0.01)):  # it lies on one point, and on many
        elastic = DirectSimulator(rod, n_elements=64, obstacles=[Plane((0, 0, -0.01), (0, 0, 1))])
        shape = elastic.track([_LEVEL, Pose((0, 0, -0.005), (0, 0, 0, 1))])[-1]
        assert corrected_by(elastic.mesh, shape, past_of(elastic.mesh, shape, None)) < 1
    corners = 0.01 * np.vstack([np.zeros(3), np.eye(3)])
    DirectSimulator(_THIN, n_elements=16, obstacles=[Mesh(corners, _TETRAHEDRON)]).solve(_LEVEL)


def held() -> None:
    """Solve with the far end held."""
    for grip in ('pinned', 'clamped'):
        direct = DirectSimulator(_ROD, grip=grip)
        for end in ((0.8, 0, 0), Pose((0.8, 0, 0), (0, 0, 0, 1))):
            shape = direct.solve(_LEVEL, far_end=end)
            assert direct.solve(_LEVEL, shape, far_end=end).error_estimate > 0
    Sensitivity(shape).by_grips(0.5)
    direct = DirectSimulator(_ROD)
    bent = direct.solve(_LEVEL, far_end=Pose((0.2, 0, 0.2), (0, 0, 0, 1)))
    for jumped in (False, True):
        assert passed_between(bent, bent, jumped) is False
    lengths, strains, frames, positions = kernel_arrays(bent)
    first_passage(lengths, *(np.stack([one] * 2) for one in (strains, frames[0], positions)))


def strands() -> None:
    """Solve a DLO that touches itself."""
    loop = Rod(1.0, 0.1, 1.0, 0.7, natural_curvature=(7.5, 0.0), natural_twist=0.1, radius=0.01)
    for basis in ('local', 'chebyshev'):
        direct = DirectSimulator(loop, basis=basis, n_elements=24, n_terms=12, self_contact=True)
        shape = direct.solve(_LEVEL)
        end = FarEnd(Pose.from_rotation(shape.positions[-1], shape.frames[-1]))
        held = direct.solve(_LEVEL, shape, far_end=end)
        direct.solve(_TILTED, held, far_end=end)
        rough = DirectSimulator(loop, basis=basis, n_elements=24, n_terms=12, self_contact=True,
                                self_friction=0.3)
        rough.solve(_TILTED, rough.solve(_LEVEL))
    direct.simulate([_LEVEL] * 3, 1e-3, initial=held, far_ends=[end] * 3)


def seen() -> None:
    """Fit and observe a DLO, and correct a plan."""
    spread = Uncertainty(0.05, 0.05, 0.05, 1e-3, 0.05, 1e-3, 1e-3, 0.05)
    direct = DirectSimulator(_ROD)
    goal = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    plan = InverseSimulator(direct).thread(goal, depths=[0, 0.03, 0.06, 0.5])
    InverseSimulator(direct).thread_sequence(
        [CutOut(Pose.looking_along((x, 0, 1), (1, 0, 0))) for x in (0, 0.2, 0.4)], depths=[0, 0.1])
    shape = direct.solve(_TILTED)
    fit_rod(_ROD, [Observation(_TILTED, shape.positions[::9])])
    observer = Observer(direct, spread, bias=1e-3)
    estimate = observer.begin()
    for s in (None, shape.s[::9]):
        estimate = observer.update(estimate, Observation(_TILTED, shape.positions[::9], s))
    correct(estimate, plan)


# Two processes take them in this order: the first is about as long as the next seven together, the
# last two need what both have compiled.
ALL = (touching, shapes, motions, seen, proofs, closed_loop, answers, many, held,
       strands, moved_in_contact, planned_among_obstacles)
