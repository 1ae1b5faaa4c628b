# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a gripper may be rolled about the DLO without the DLO knowing."""

from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.equilibria import is_axisymmetric
from dlo_planner.model.checks import instance
from dlo_planner.plan.plan import Plan


def rolls_freely(simulator: DirectSimulator | GraspedInside, plan: Plan) -> bool:
    """Whether one constant roll of all grippers of a Plan about their x axes changes no shape.

    The DLO has to be straight without stress, equally stiff and thick all around, and elastic (a
    set has a direction); nothing may hold its far end, which would keep the roll there.

    Parameters
    ----------
    simulator : DirectSimulator or GraspedInside
        Simulator of the DLO that the plan is for.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """
    instance('simulator', simulator, (DirectSimulator, GraspedInside))
    instance('plan', plan, Plan)
    rod = simulator.rod
    round_ = rod.section is None or rod.section.kind != 'rectangular'
    loose = all(shape.far_end is None and shape.parts is None for shape in plan.shapes)
    return bool(round_ and loose and not rod.yields and is_axisymmetric(rod))
