# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole way through cut-outs, as the parameters `threading.*` ask for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.solvers.threading.one_cutout import trim_to_clearance
from dlo_planner.inverse.tasks import Approach, threading_of
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.assembly import concatenate
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress
from dlo_planner.settings.building import limits_of, tolerance_of


@dataclass(frozen=True)
class Wanted:
    """What is asked of the way; attributes are the parameters `threading.*` of the same names.

    `limits` are all those of the motion. With a standoff below 0 it is found; a tolerance of None
    is the default one.
    """

    waypoints: int
    deepest: float
    limits: Limits
    standoff: float
    gripper_clearance: float
    tolerance: float | None = None

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> 'Wanted':
        """Return that of parameter values."""
        return cls(values['threading.waypoints'], values['threading.deepest'], limits_of(values),
                   values['threading.standoff'], values['threading.gripper_clearance'],
                   tolerance_of(values))


@dataclass(frozen=True)
class Present:
    """Where the gripper and the DLO are now; None where that is not known.

    Attributes
    ----------
    gripper : Pose or None
        Pose of the gripper.
    shape : Shape or None
        Shape of the DLO, which matters where the plan begins at the gripper's pose.
    """

    gripper: Pose | None = None
    shape: Shape | None = None


def way_through(inverse: InverseSimulator, cutouts: Sequence[CutOut], wanted: Wanted,
                present: Present = Present(), *, progress: OnProgress = None,  # noqa: B008 - frozen
                deadline: float | None = None) -> Plan:
    """Return the Plan through cut-outs; with a standoff, it begins at the gripper's present pose.

    Parameters
    ----------
    inverse : InverseSimulator
    cutouts : sequence of CutOut
        One, two, or more, in the order in which they are passed.
    wanted : Wanted
        Wanted, or what has its attributes.
    present : Present, optional
        Where gripper and DLO are now; without a gripper, the threading begins where it is best.
    progress : callable, optional
        As for `InverseSimulator.thread`.
    deadline : float, optional
        As for `InverseSimulator.thread`.

    Raises
    ------
    DloPlannerError
        Refused, with the reason.
    """
    start = present.gripper
    depths = np.linspace(0.0, wanted.deepest * inverse.simulator.rod.length, wanted.waypoints)
    options: dict[str, Any] = {'progress': progress, 'requirements': replace(
        inverse.requirements, deadline=deadline, limits=wanted.limits)}
    plan = inverse.plan(threading_of(cutouts, depths), start=start, **options)
    if wanted.gripper_clearance:
        plan = inverse.check(trim_to_clearance(plan, cutouts[0], wanted.gripper_clearance, True))
    if not wanted.standoff or start is None:
        return plan
    standoff = None if wanted.standoff < 0 else wanted.standoff
    way = inverse.plan(Approach(cutouts[0], plan.shapes[0], standoff, plan, wanted.tolerance),
                       start=start, initial=present.shape, **options)
    return inverse.check(concatenate(way, plan))
