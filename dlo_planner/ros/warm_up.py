# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Loading the compiled kernels, or compiling them where that was not done at installation.

Everything that the node may be asked for is done once on a small DLO, so that no request waits for
a compiler; what has a process of its own (`ros.worker`) is done there.
"""

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.execute.judge import aimed_anew
from dlo_planner.execute.threading_loop import Threading, way_back, way_in, way_to_standoff
from dlo_planner.identify.correction import correct
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.observer import Observer
from dlo_planner.identify.parameters import Uncertainty
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Plane
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.verify.replay import replay

_ROD = Rod(1.0, 0.01, 1.0, 1.0, radius=1e-3)


def warm_up() -> None:
    """Use every kernel that an answer of the node may need."""
    rod = _ROD
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
        lying = DirectSimulator(rod, basis=basis, n_elements=16, n_terms=4, obstacles=[floor])
        lying.solve(level, lying.solve(level))
    yielding = Rod(1.0, 0.01, 1.0, 1.0, yield_curvature=0.01, hardening=0.5)
    DirectSimulator(yielding, n_elements=16, n_terms=4).solve(level)


def warm_up_proofs() -> None:
    """Use every kernel that a proof may need."""
    for basis in ('local', 'chebyshev'):
        direct = DirectSimulator(_ROD, basis=basis, n_elements=16, n_terms=4)
        plan = InverseSimulator(direct).thread(_hole(0.0), depths=[0.0, 0.1])
        replay(direct, plan, limits=Limits())


def warm_up_corrections() -> None:
    """Use every kernel that a look at the DLO, or a correction of what is executed, may need."""
    for basis in ('local', 'chebyshev'):
        direct = DirectSimulator(_ROD, basis=basis, n_elements=16, n_terms=4)
        plan = InverseSimulator(direct).thread(_hole(0.0), depths=[0.0, 0.1])
        observer = Observer(direct, Uncertainty(0.05, 0.05, 0.05, natural_curvature=0.1))
        seen = plan.shapes[0]
        estimate = observer.update(observer.begin(), Observation(seen.gripper, seen.positions))
        correct(estimate, plan)
        plan.shapes[-1].modes(1)  # of which the windows of a correction are made


def warm_up_loop() -> None:
    """Use the kernels that a plan of a closed loop may need, or a correction."""
    direct = DirectSimulator(_ROD, n_elements=16, n_terms=4)
    task = Threading(InverseSimulator(direct), _hole(0.0), np.array([0.0, 0.1]), 0.1)
    here = Pose((-1.2, 0, 0), (0, 0, 0, 1))
    observer = Observer(direct, Uncertainty(0.05, 0.05, 0.05, natural_curvature=0.1))
    estimate = observer.update(observer.begin(), Observation(here, direct.solve(here).positions))
    way_to_standoff(task, estimate, here)
    entry = way_in(task, estimate, here, np.inf, 0.5)
    assert entry.motion is not None  # any bound will do
    way = entry.motion.steered
    aimed_anew(task.inverse, estimate, entry.commanded, way, 0.0,
               way.reached(entry.whole.times[-len(entry.commanded):]), None, np.inf, 0.5)
    way_back(task, estimate, way.poses(way.duration * np.array([0.1, 0.05, 0.0])),
             entry.whole.shapes[0])


def _hole(x: float) -> CutOut:
    return CutOut(Pose.looking_along((x, 0, 0), (1, 0, 0)), radius=0.1)
