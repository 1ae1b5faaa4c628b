# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The one door to Pinocchio, which is an extra."""

from typing import Any

from dlo_planner.errors import InvalidTask

_REMEDY = ("the joints of an arm need Pinocchio: expected the extra 'dlo_planner[arm]' "
           '(package `pin` of PyPI, ros-jazzy-pinocchio of ROS)')


def pinocchio() -> Any:
    """Return the module."""
    try:
        import pinocchio as module  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise InvalidTask(f'{_REMEDY}; {error}') from None
    if not hasattr(module, 'buildReducedModel'):
        raise InvalidTask(f'{_REMEDY}; {getattr(module, "__file__", None)} is another package')
    return module
