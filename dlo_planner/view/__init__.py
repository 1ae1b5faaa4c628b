# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of shapes and plans, and a page in the browser that shows them; no ROS in here."""

from collections.abc import Iterable
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.checks import choice, instance
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.plan.plan import Plan
from dlo_planner.view.colors import COLORINGS
from dlo_planner.view.pages import PlanPage, Replanner
from dlo_planner.view.viser import LOCAL, PORT, Page

__all__ = ['view']


def view(plan: Plan, inverse: InverseSimulator | None = None, *,
         obstacles: Iterable[Obstacle] | None = None, color: str = 'curvature',
         host: str = LOCAL, port: int = PORT) -> PlanPage:
    """Open a page in the browser that shows a plan: `view(plan).wait()`.

    The plan can be looked at over time. Where it goes through one cut-out, gripper and cut-out can
    be dragged: the DLO follows the gripper, a cut-out that is dragged is planned anew
    (`InverseSimulator.thread`). What is refused is said on the page.

    Parameters
    ----------
    plan : Plan
    inverse : InverseSimulator, optional
        InverseSimulator to plan anew with. If None, one of the rod and the surroundings of the
        plan's shapes, without a workspace.
    obstacles : iterable of obstacle, optional
        Obstacles that are drawn. If None, those of `inverse` and its workspace.
    color : str, optional
        'curvature', 'yield' or 'tension'.
    host : str, optional
        Where the page is offered; another one than localhost lets the whole network in.
    port : int, optional
        Port of the page, or the next free one; `PlanPage.url` says which.

    Returns
    -------
    PlanPage
        PlanPage.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    MissingExtra
        Viser is not installed (extra `view`).
    """
    if not isinstance(plan, Plan) or not len(plan):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    instance('inverse', inverse, InverseSimulator, optional=True)
    choice('color', color, COLORINGS)
    try:
        replanner: Replanner | str = Replanner.of(plan, inverse)
    except InvalidTask as error:
        replanner = str(error)
    if obstacles is None:
        obstacles = _around(inverse or getattr(replanner, 'inverse', None))
    return PlanPage(Page('dlo_planner', host, port), plan, replanner, obstacles, color)


def _around(inverse: InverseSimulator | None) -> tuple[Any, ...]:
    """Return what stands around the DLO of an InverseSimulator, each thing once; () for None."""
    if inverse is None:
        return ()
    keep_out = () if inverse.workspace is None else inverse.workspace.keep_out
    given = inverse.simulator.surroundings.obstacles
    return (*given, *(body for body in keep_out if body not in given))
