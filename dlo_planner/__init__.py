# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Direct and inverse simulation of deformable linear objects in a gripper; no ROS in here.

The names are those of `public`. Each is imported from where `public` has it, when it is first asked
for: all of them take a second, in which a node that is only being started could not hear a signal.
"""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_planner.public import *  # noqa: F403

__version__ = '0.1.0'  # the one place; package.xml and CITATION.cff repeat it, a test compares


@cache
def _homes() -> dict[str, str]:
    """Return the modules from which `public` imports its names; nothing where it has no source."""
    try:
        lines = ast.parse(Path(__file__).with_name('public.py').read_text(encoding='utf-8')).body
    except OSError:
        return {}
    return {item.name: str(line.module) for line in lines if isinstance(line, ast.ImportFrom)
            for item in line.names}


def __getattr__(name: str) -> Any:
    if name.startswith('__') and name != '__all__':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    home = import_module(_homes().get(name, 'dlo_planner.public'))
    if name != '__all__' and home.__name__ == 'dlo_planner.public' and name not in home.__all__:
        if name in globals():  # a subpackage, which is imported by now
            return globals()[name]
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    globals()[name] = getattr(home, name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module('dlo_planner.public').__all__})
