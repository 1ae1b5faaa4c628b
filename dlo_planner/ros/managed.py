# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A managed node (lifecycle) that is seen when it is ready, and can configure itself."""

import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter_service import ParameterService

from dlo_planner.errors import DloPlannerError

_EXPECTED = (DloPlannerError, ParameterException)


class ManagedNode(LifecycleNodeMixin, Node):
    """Base of a managed node; `configure`, `activate`, `deactivate` and `clean_up` are its own.

    The services of parameters and of the lifecycle are there after `show`, and not before: whoever
    sees them is answered. An exception in one of the four is written to the log; the state is then
    the one before (DloPlannerError), or unconfigured.

    Parameters
    ----------
    name : str
        Name of the node.
    options : object
        Options of rclpy's Node.
    """

    def __init__(self, name: str, **options: Any) -> None:
        Node.__init__(self, name, start_parameter_services=False,
                      automatically_declare_parameters_from_overrides=True, **options)
        self.lifecycle_state = 'starting'

    def show(self) -> None:
        """Make the services of parameters and of the lifecycle."""
        self._parameters_shown = ParameterService(self)
        # not with the parameters' services: a transition may take long
        LifecycleNodeMixin.__init__(self, callback_group=MutuallyExclusiveCallbackGroup())
        for service in self.services:
            service.callback = self._surviving(service.callback, service.srv_name)
        self.lifecycle_state = 'unconfigured'

    def start_up(self) -> None:
        """Go on to active; raise DloPlannerError if that is refused."""
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise DloPlannerError(self._failure)

    def end(self) -> None:
        """Finalize the node, whatever its state is; return when nothing moves any more."""
        with suppress(rclpy_implementation.RCLError):  # it is final already, or changes just now
            self.trigger_shutdown()

    def destroy_node(self) -> None:
        """Leave, with the lifecycle's publisher, which rclpy leaves to the garbage collector."""
        if self.lifecycle_state != 'starting':
            self._state_machine.destroy_when_not_in_use()
        super().destroy_node()

    def _surviving(self, callback: Callable[..., Any], name: str) -> Callable[..., Any]:
        """Return a callback of a service that cannot end the node, whatever it is asked.

        Those of rclpy raise for some requests: a transition, or a type of parameter, that does not
        exist.
        """
        @wraps(callback)
        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                reason = ' '.join(f'{type(error).__name__}: {error}'.split())
                self.get_logger().warning(f'{name} refused: {reason}', throttle_duration_sec=1.0)
                return _refused(request, response, reason)
        return answer

    # ---- what a node does -----------------------------------------------------------------------

    def configure(self) -> None:
        """Read parameters, make what is offered; it does not act yet."""

    def activate(self) -> None:
        """Begin to act."""

    def deactivate(self) -> None:
        """Let motion come to rest, cease to act."""

    def clean_up(self) -> None:
        """Take back what `configure` did."""

    # ---- transitions, called by rclpy -----------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure."""
        return self._passed(state, LifecycleNodeMixin.on_configure, 'inactive', self.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Switch publishers on, then activate."""
        super().on_activate(state)
        return self._passed(state, None, 'active', self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate, then switch publishers off."""
        return self._passed(state, LifecycleNodeMixin.on_deactivate, 'inactive', self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        return self._passed(state, LifecycleNodeMixin.on_cleanup, 'unconfigured', self.clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and clean up, as far as that is due."""
        due = {'active': (self.deactivate, self.clean_up), 'inactive': (self.clean_up,)}
        return self._passed(state, LifecycleNodeMixin.on_shutdown, 'finalized',
                            *due.get(state.label, ()))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Become unconfigured."""
        return self._passed(state, LifecycleNodeMixin.on_error, 'unconfigured', self.deactivate,
                            self.clean_up)

    def _passed(self, state: Any, after: Callable[..., Any] | None, label: str,
                *steps: Callable[..., Any]) -> TransitionCallbackReturn:
        try:
            for step in steps:
                step()
        except _EXPECTED as error:
            self._failure = str(error)
            self.get_logger().error(self._failure)
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self._failure = f'{type(error).__name__}: {error}'
            self.get_logger().error(traceback.format_exc())
            return TransitionCallbackReturn.ERROR
        self.lifecycle_state = label
        return TransitionCallbackReturn.SUCCESS if after is None else after(self, state)


def _refused(request: Any, response: Any, reason: str) -> Any:
    """Return a response that says so, where it can; what was done before stays answered."""
    refusal = SetParametersResult(successful=False, reason=reason)
    if hasattr(response, 'results'):
        missing = len(request.parameters) - len(response.results)
        response.results = [*response.results, *[refusal] * missing]
    elif hasattr(response, 'result') and isinstance(response.result, SetParametersResult):
        response.result = refusal
    return response
