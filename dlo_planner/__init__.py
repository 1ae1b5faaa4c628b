# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Direct and inverse simulation of deformable linear objects in a gripper; no ROS in here.

The names are those of `public`, which is imported with the first of them: it takes a second, in
which a node that is only being started could not hear a signal.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_planner.public import *  # noqa: F403

__version__ = '0.1.0'  # the one place; package.xml and CITATION.cff repeat it, a test compares


_RENAMED = {'tolerance': 'robustness', 'Tolerance': 'Robustness',
            'minimise_penalty': 'minimize_penalty', 'Found': 'PenaltyResult',
            'joined': 'concatenate', 'Report': 'ValidationReport',
            'Spread': 'Uncertainty'}  # gone after the next version


def __getattr__(name: str) -> Any:
    if name.startswith('__') and name != '__all__':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    public = import_module('dlo_planner.public')
    if name in _RENAMED:
        warnings.warn(f'dlo_planner.{name} is now dlo_planner.{_RENAMED[name]}', DeprecationWarning,
                      stacklevel=2)
        return getattr(public, _RENAMED[name])
    if name != '__all__' and name not in public.__all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    globals()[name] = getattr(public, name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module('dlo_planner.public').__all__})
