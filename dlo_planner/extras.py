# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What only some parts need: imported where used; packages are named where they are missing."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

from dlo_planner.errors import MissingExtra


def extra(module: str, name: str, purpose: str) -> ModuleType:
    """Return a module of an optional package."""
    package = module.split('.', maxsplit=1)[0]
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or '').split('.')[0] != package:
            raise  # the package is there, and misses another one
        raise MissingExtra(f"{purpose} need {package}, which the extra '{name}' installs: "
                           f"pip install 'dlo_planner[{name}]'", name=error.name) from None


def studied(name: str) -> Any:
    """Return 'module.function' of the room `study`, the paper's methods, which is found by name."""
    module, _, function = name.rpartition('.')
    return getattr(import_module(f'dlo_planner.study.{module}'), function)
