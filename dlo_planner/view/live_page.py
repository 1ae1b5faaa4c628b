# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A running planner in the browser: its pictures, messages and requests."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from dlo_planner.model.pose import Pose
from dlo_planner.view import tables
from dlo_planner.view.item import Item
from dlo_planner.view.page import Page, pose_of, put_at

_HANDLE = 0.12  # m
_GOAL_AT = Pose((0.6, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))  # until it is dragged
_START_AT = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))  # until the gripper is known
_UNHEARD = 'nothing heard yet'


@dataclass(frozen=True)
class Actions:
    """What the page can ask for; each is called in a thread of the page, and answers by `say`.

    Attributes
    ----------
    goal : callable
        Called with the Pose of a cut-out.
    replan, execute, cancel : callable
        Called without arguments.
    """

    goal: Callable[[Pose], object]
    replan: Callable[[], object]
    execute: Callable[[], object]
    cancel: Callable[[], object]


class LivePage:
    """Shows Items, states and margins as they come; a gripper and a goal can be dragged.

    Parameters
    ----------
    page : Page
    actions : Actions
    allow_execute : bool, optional
        Whether the button that executes a plan works; it asks first.
    """

    def __init__(self, page: Page, actions: Actions, allow_execute: bool = False) -> None:
        self.page = page
        self._actions, self._allow_execute = actions, allow_execute
        self._states: dict[str, str] = {}
        gui = page.gui
        self.message = gui.add_html(tables.message('nothing asked yet'))
        with gui.add_folder('State'):
            self.state = gui.add_html(tables.message(_UNHEARD))
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
            self.margins = gui.add_html(tables.message(_UNHEARD))
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

    def show(self, items: Iterable[Item]) -> None:
        """Show these Items and no others."""
        self.page.show(items)

    def say(self, text: str, level: int = 0) -> None:
        """Show an answer; level 0 ok, 1 warning, 2 error."""
        self.message.content = tables.message(text, level)

    def put_state(self, name: str, level: int, text: str) -> None:
        """Show the state of one thing, in a line of its own."""
        self._states[name] = tables.message(f'{name}: {text}', level)
        self.state.content = ''.join(self._states.values())

    def put_margins(self, values: Mapping[str, str]) -> None:
        """Show named figures."""
        self.margins.content = (tables.values_table(values, 'of the last shape and plan')
                                if values else tables.message('no plan yet'))

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
            gui.add_html(tables.message('the robot will move', 1))
            self.yes, self.no = gui.add_button('Execute', color='red'), gui.add_button('Back')

        def execute(_: object) -> None:
            modal.close()
            self._actions.execute()

        self.yes.on_click(execute)
        self.no.on_click(lambda _: modal.close())
