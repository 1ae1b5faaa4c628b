# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pages in the browser: a plan over time, replanned by dragging; a running planner."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from threading import RLock, Thread
from time import monotonic, sleep
from typing import Any

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError, InvalidTask, NotConverged
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.tasks.approach import first_approach
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.progress import Latest, OnProgress
from dlo_planner.view.colors import COLORINGS
from dlo_planner.view.primitives import Primitive
from dlo_planner.view.scene import (
    cutouts_of,
    obstacle_primitives,
    plan_primitives,
    shape_primitives,
)
from dlo_planner.view.viser import Page, margins, message, pose_of, put_at, table

_SECONDS = 30.0   # of computing, after which a plan is given up
_WAYPOINTS = 60   # most of a plan that follows a hand


@dataclass(frozen=True)
class Replanner:
    """Makes plans through one cut-out like a given one, and shapes of the same DLO."""

    inverse: InverseSimulator
    depths: Floats  # (n,) Depths in m, of the waypoints

    @classmethod
    def of(cls, plan: Plan, inverse: InverseSimulator | None = None) -> 'Replanner':
        """Return one for a Plan."""
        if not len(plan):
            raise InvalidTask('plan: expected one with a waypoint')
        last, mesh = plan.shapes[-1], plan.shapes[-1].mesh
        if inverse is None and mesh is None:
            raise InvalidTask('plan: its shapes know no rod (they come from a file): expected '
                              '`inverse` to plan anew with')
        if len(cutouts_of(plan)) != 1 or last.holds or last.parts is not None:
            raise InvalidTask('plan: expected one through one cut-out, of a DLO that is held at '
                              'its beginning, where it is to be made anew')
        if inverse is None:
            assert mesh is not None  # see above
            around = mesh.surroundings
            inverse = InverseSimulator(DirectSimulator(
                around.rod, gravity=around.gravity, load=around.load, grip=around.grip,
                obstacles=around.obstacles, point_loads=around.point_loads))
        return cls(inverse, np.linspace(0.0, float(plan.depths.max()),
                                        min(len(plan), _WAYPOINTS)))

    def plan(self, cutout: CutOut, gripper: Pose, whole: bool, progress: OnProgress) -> Plan:
        """Return the Plan through a CutOut."""
        options: dict[str, Any] = {'progress': progress, 'deadline': _SECONDS}
        plan = self.inverse.thread(cutout, start=gripper, depths=self.depths, **options)
        if not whole:
            return plan
        way = first_approach(self.inverse.approach, self.inverse.simulator.rod.length, cutout, plan,
                             gripper, **options)
        return concatenate(way, plan)

    def shape(self, gripper: Pose, before: Shape) -> Shape:
        """Return the Shape at a gripper's Pose, coming from another Shape."""
        shape = self.inverse.simulator.track([gripper], initial=before)[0]
        if not shape.converged:
            raise NotConverged(f'no stable shape found: {shape.status}', shape)
        return shape


_FRAME = 0.05    # s between pictures of a plan that is played
_STEP = 0.01     # s, of the slider
_HANDLE_PART = 0.12   # of the DLO's length


class PlanPage:
    """Shows a Plan; `dlo_planner.view.view` makes it."""

    def __init__(self, page: Page, plan: Plan, replanner: Replanner | str,
                 obstacles: Iterable[Obstacle] = (), color: str = 'curvature') -> None:
        self.page, self.plan = page, plan
        self._replanner = None if isinstance(replanner, str) else replanner
        self._cutouts = cutouts_of(plan)
        self._obstacles = obstacle_primitives(obstacles)
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
        self.gripper = self.page.control('gripper', self.plan.grippers[0], _HANDLE_PART * length)
        self.cutout = self.page.control('cutout', self._cutouts[0].pose, _HANDLE_PART * length)
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
        self.message.content = message(text, level)

    def _draw(self) -> None:
        with self._lock:
            plan, shape = self.plan, self._loose or self.plan.shapes[self.index]
            self.page.show([
                *self._obstacles, *shape_primitives(shape, self.color.value),
                *plan_primitives(plan, self._cutouts, 6 if self.ghosts.value else 0)])
            self.table.content = margins(plan, self.index)


def _end(plan: Plan) -> float:
    """Return the end of a plan's times in s, rounded up to steps of the slider."""
    return max(float(np.ceil(plan.times[-1] / _STEP)), 1.0) * _STEP


_HANDLE = 0.12  # m
_GOAL_AT = Pose((0.6, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))  # until it is dragged
_START_AT = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))  # until the gripper is known
_UNHEARD = 'nothing heard yet'


@dataclass(frozen=True)
class Actions:
    """What the page can ask for; each is called in a thread of the page, and answers by `say`."""

    goal: Callable[[Pose], object]  # Called with the Pose of a cut-out
    replan: Callable[[], object]
    execute: Callable[[], object]
    cancel: Callable[[], object]


class LivePage:
    """Shows Primitives, states and margins as they come; a gripper and a goal can be dragged."""

    def __init__(self, page: Page, actions: Actions, allow_execute: bool = False) -> None:
        self.page = page
        self._actions, self._allow_execute = actions, allow_execute
        self._states: dict[str, str] = {}
        gui = page.gui
        self.message = gui.add_html(message('nothing asked yet'))
        with gui.add_folder('State'):
            self.state = gui.add_html(message(_UNHEARD))
        with gui.add_folder('Plan'):
            self.replan = gui.add_button('Plan again')
            self.execute = gui.add_button(
                'Execute ...', color='red', disabled=not allow_execute,
                hint='asks first' if allow_execute else 'parameter allow_execute is false')
            self.cancel = gui.add_button('Cancel')
        with gui.add_folder('Goal'):
            self.aiming = gui.add_checkbox('drag a cut-out', False)
            self.send_goal = gui.add_button('Plan to the dragged cut-out', disabled=True)
        with gui.add_folder('Gripper'):
            self.sending = gui.add_checkbox('send the dragged pose', False, hint='on '
                                            '~/gripper_pose; where a robot sends it, it is refused')
        with gui.add_folder('Margins'):
            self.margins = gui.add_html(message(_UNHEARD))
        self.gripper = page.control('gripper', _START_AT, _HANDLE)
        self.goal = page.control('goal', _GOAL_AT, _HANDLE)
        self.gripper.visible = self.goal.visible = False
        self._connect()

    def _connect(self) -> None:
        self.sending.on_update(lambda _: setattr(self.gripper, 'visible', self.sending.value))
        self.aiming.on_update(lambda _: self._aim())
        self.send_goal.on_click(lambda _: self._actions.goal(pose_of(self.goal)))
        self.replan.on_click(lambda _: self._actions.replan())
        self.cancel.on_click(lambda _: self._actions.cancel())
        self.execute.on_click(lambda event: self._ask(event.client))

    # ---- what it is told ------------------------------------------------------------------------

    def show(self, items: Iterable[Primitive]) -> None:
        """Show these Primitives and no others."""
        self.page.show(items)

    def say(self, text: str, level: int = 0) -> None:
        """Show an answer; level 0 ok, 1 warning, 2 error."""
        self.message.content = message(text, level)

    def put_state(self, name: str, level: int, text: str) -> None:
        """Show the state of one thing, in a line of its own."""
        self._states[name] = message(f'{name}: {text}', level)
        self.state.content = ''.join(self._states.values())

    def put_margins(self, values: Mapping[str, str]) -> None:
        """Show named figures."""
        self.margins.content = (table(('of the last shape and plan', ''), list(values.items()))
                                if values else message('no plan yet'))

    def put_gripper(self, pose: Pose) -> None:
        """Place the gripper that can be dragged; not while it is."""
        if not self.sending.value:
            put_at(self.gripper, pose)

    def put_goal(self, pose: Pose) -> None:
        """Place the cut-out that can be dragged; not while it is."""
        if not self.aiming.value:
            put_at(self.goal, pose)

    @property
    def dragged(self) -> Pose | None:
        """Pose of the gripper that is to be sent; None if none is, or nobody looks."""
        watched = bool(self.page.server.get_clients())
        return pose_of(self.gripper) if self.sending.value and watched else None

    def stop_sending(self, why: str) -> None:
        """Untick the box that sends the dragged gripper, and say why."""
        self.sending.value = False
        self.say(why, 1)

    # ---- what users do --------------------------------------------------------------------------

    def _aim(self) -> None:
        self.goal.visible = self.aiming.value
        self.send_goal.disabled = not self.aiming.value

    def _ask(self, client: Any) -> None:
        """Ask whoever clicked whether the plan is to be executed."""
        if not self._allow_execute:
            self.say('not executed: parameter allow_execute is false', 1)
            return
        gui = self.page.gui if client is None else client.gui
        modal = gui.add_modal('Execute the plan?')
        with modal:
            gui.add_html(message('the robot will move', 1))
            self.yes, self.no = gui.add_button('Execute', color='red'), gui.add_button('Back')

        def execute(_: object) -> None:
            modal.close()
            self._actions.execute()

        self.yes.on_click(execute)
        self.no.on_click(lambda _: modal.close())
