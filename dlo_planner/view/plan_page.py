# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan in the browser: looked at over time, its gripper and its cut-out dragged."""

from collections.abc import Iterable
from threading import RLock, Thread
from time import monotonic, sleep

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view import tables
from dlo_planner.view.colors import COLORINGS
from dlo_planner.view.dlo_items import (
    axes_items,
    contact_items,
    dlo_items,
    drawn_radius,
    ghost_items,
)
from dlo_planner.view.item import Item
from dlo_planner.view.latest import Latest
from dlo_planner.view.page import Page, pose_of, put_at
from dlo_planner.view.replanning import Replanner, cutouts_of
from dlo_planner.view.scene_items import cutout_items, margin_items, obstacle_items, path_items

_FRAME = 0.05    # s between pictures of a plan that is played
_STEP = 0.01     # s, of the slider
_HANDLE = 0.12   # of the DLO's length


class PlanPage:
    """Shows a Plan; `dlo_planner.view.view` makes it.

    Parameters
    ----------
    page : Page
    plan : Plan
        Plan with a waypoint.
    replanner : Replanner or str
        Replanner, or the text that says why there is none.
    obstacles : iterable of obstacle, optional
        Obstacles that are drawn.
    color : str, optional
        As in `coloring`.
    """

    def __init__(self, page: Page, plan: Plan, replanner: Replanner | str,
                 obstacles: Iterable[Obstacle] = (), color: str = 'curvature') -> None:
        self.page, self.plan = page, plan
        self._replanner = None if isinstance(replanner, str) else replanner
        self._cutouts = cutouts_of(plan)
        self._obstacles = obstacle_items(obstacles)
        self._loose: Shape | None = None  # Shape at the dragged gripper, while it is shown
        self._lock = RLock()
        self._worker = Latest(self._refused)
        self._build(color)
        if isinstance(replanner, str):
            self._say(f'to be looked at only: {replanner}', 1)
        else:
            self._say('drag the gripper or the cut-out')
            self._add_controls()
        self._draw()

    @property
    def url(self) -> str:
        """Where the page is."""
        return self.page.url

    def __repr__(self) -> str:
        return f'PlanPage({self.url})'

    def wait(self) -> None:
        """Return when the page is closed, or at Ctrl-C."""
        self.page.wait()

    def close(self) -> None:
        """End the server and the planning."""
        self.playing.value = False
        self._worker.close()
        self.page.close()

    def settle(self, timeout: float = 60.0) -> bool:
        """Return whether all that was asked for is done within `timeout` s."""
        return self._worker.wait(timeout)

    # ---- what it consists of --------------------------------------------------------------------

    def _build(self, color: str) -> None:
        gui = self.page.gui
        self.time = gui.add_slider('time [s]', 0.0, _end(self.plan), _STEP, 0.0)
        self.playing = gui.add_checkbox('play', False)
        self.color = gui.add_dropdown('color', COLORINGS, initial_value=color)
        self.ghosts = gui.add_checkbox('ghost shapes', True)
        self.whole = gui.add_checkbox('plan begins at the gripper', False,
                                      visible=self._replanner is not None)
        self.message = gui.add_html('')
        self.table = gui.add_html('')
        self.time.on_update(lambda _: self._looked_at())
        self.playing.on_update(lambda _: self._play())
        for handle in (self.color, self.ghosts):
            handle.on_update(lambda _: self._draw())
        self.whole.on_update(lambda _: self._cutout_dragged())

    def _add_controls(self) -> None:
        length = float(self.plan.shapes[0].s[-1])
        self.gripper = self.page.control('gripper', self.plan.grippers[0], _HANDLE * length)
        self.cutout = self.page.control('cutout', self._cutouts[0].pose, _HANDLE * length)
        self.gripper.on_update(lambda _: self._gripper_dragged())
        self.cutout.on_update(lambda _: self._cutout_dragged())

    # ---- what users do --------------------------------------------------------------------------

    @property
    def index(self) -> int:
        """The waypoint that is looked at: the last one whose time has come."""
        return int(np.searchsorted(self.plan.times, self.time.value + 1e-9, side='right')) - 1

    def _looked_at(self) -> None:
        with self._lock:
            self._loose = None
            if self._replanner is not None:
                put_at(self.gripper, self.plan.grippers[self.index])
            self._draw()

    def _play(self) -> None:
        if self.playing.value:
            Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        begun = monotonic() - (self.time.value if self.time.value < self.time.max else 0.0)
        while self.playing.value:
            now = min(monotonic() - begun, self.time.max)
            self.time.value = now
            if now >= self.time.max:
                self.playing.value = False
            sleep(_FRAME)

    def _gripper_dragged(self) -> None:
        if self.whole.value:
            self._cutout_dragged()
            return
        replanner, pose = self._replanner, pose_of(self.gripper)
        if replanner is not None:
            self._worker.submit(lambda: self._follow(replanner, pose))

    def _cutout_dragged(self) -> None:
        replanner = self._replanner
        if replanner is not None:
            poses = pose_of(self.cutout), pose_of(self.gripper)
            self._worker.submit(lambda: self._plan_anew(replanner, *poses, self.whole.value))

    # ---- the work, in the worker's thread -------------------------------------------------------

    def _follow(self, replanner: Replanner, pose: Pose) -> None:
        shape = replanner.shape(pose, self._loose or self.plan.shapes[self.index])
        with self._lock:
            self._loose = shape
            self._say('the DLO jumped into another shape on the way' if shape.jumped else
                      'the DLO at the dragged gripper; the slider goes back to the plan',
                      int(shape.jumped))
            self._draw()

    def _plan_anew(self, replanner: Replanner, pose: Pose, gripper: Pose, whole: bool) -> None:
        begun = monotonic()
        known = self._cutouts[0]
        cutout = CutOut(pose, known.radius, known.width, known.height)
        plan = replanner.plan(cutout, gripper, whole, self._worker.check)
        with self._lock:
            share = self.time.value / self.time.max
            self.plan, self._cutouts, self._loose = plan, [cutout], None
            self._say(f'planned {len(plan)} waypoints in {1e3 * (monotonic() - begun):.0f} ms, '
                      f'{plan.times[-1]:.3g} s long')
            self.time.max = _end(plan)
            self.time.value = 0.0 if whole else round(share * _end(plan), 2)
            put_at(self.gripper, plan.grippers[self.index])
            self._draw()

    def _refused(self, error: Exception) -> None:
        kind = '' if isinstance(error, DloPlannerError) else f'{type(error).__name__}: '
        self._say(f'refused: {kind}{error}', 2)

    # ---- pictures -------------------------------------------------------------------------------

    def _say(self, text: str, level: int = 0) -> None:
        self.message.content = tables.message(text, level)

    def _draw(self) -> None:
        with self._lock:
            plan, shape = self.plan, self._loose or self.plan.shapes[self.index]
            self.page.show([*self._scene(plan), *self._dlo(shape)])
            self.table.content = tables.margins(plan, self.index)

    def _scene(self, plan: Plan) -> list[Item]:
        radius = _radius(plan.shapes[0])
        ghosts = ghost_items(plan.shapes, radius) if self.ghosts.value else []
        return [*self._obstacles, *cutout_items(self._cutouts), *path_items(plan.grippers),
                *margin_items(plan, self._cutouts, radius), *ghosts]

    def _dlo(self, shape: Shape) -> list[Item]:
        return [*dlo_items(shape, _radius(shape), self.color.value), *contact_items(shape),
                *axes_items('gripper', shape.gripper)]


def _end(plan: Plan) -> float:
    """Return the end of a plan's times in s, rounded up to steps of the slider."""
    return max(float(np.ceil(plan.times[-1] / _STEP)), 1.0) * _STEP


def _radius(shape: Shape) -> float | None:
    return None if shape.rod is None else drawn_radius(shape.rod)


def checked(plan: Plan) -> Plan:
    """Return a Plan that can be shown, or raise InvalidTask."""
    if not isinstance(plan, Plan) or not len(plan):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    return plan
