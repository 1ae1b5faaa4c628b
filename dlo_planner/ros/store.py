# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The one place in which the State of the node is changed."""

from collections.abc import Callable
from threading import Lock

from dlo_planner.ros.state import State


class Store:
    """Holds the State; every change of it goes through one lock."""

    def __init__(self, state: State) -> None:
        self._lock = Lock()
        self._state = state
        # Scenes take long to build. Whoever replaces it holds this one from reading to writing:
        # shapes, plans and commands do not wait for it.
        self.rebuilding = Lock()

    @property
    def state(self) -> State:
        """The State now."""
        return self._state

    def change(self, change: Callable[[State], State]) -> State:
        """Replace the State by what `change` returns of it, and return that.

        Parameters
        ----------
        change : callable
            Pure and quick; what it raises leaves the State as it is.
        """
        with self._lock:
            self._state = change(self._state)
            return self._state
