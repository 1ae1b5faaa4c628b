# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""For which processors kernels are compiled: this one, and any of the kind at installation."""

from __future__ import annotations

from functools import cache

import llvmlite.binding as llvm
import numba
from numba.core.registry import cpu_target

# Instructions of x86-64-v2, which processors have had since 2009.
_V2 = ('cx16', 'popcnt', 'sahf', 'sse3', 'ssse3', 'sse4.1', 'sse4.2')


def accepted(target: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return the processors whose machine code this one runs, the best first."""
    asked = numba.config.CPU_NAME is not None or numba.config.CPU_FEATURES is not None
    return (target,) if asked or not _runs_generic() else (target, (target[0], *generic()))


@cache
def generic() -> tuple[str, str]:
    """Return the name and features of the processor that an installation is compiled for."""
    x86 = llvm.get_process_triple().startswith('x86_64')
    return ('x86-64-v2' if x86 else 'generic'), ''


@cache
def _runs_generic() -> bool:
    if generic()[0] == 'generic':
        return True
    features = llvm.get_host_cpu_features()
    return all(features.get(name, False) for name in _V2)


def compile_generic() -> None:
    """Compile for the processor of `generic` from now on."""
    if not _runs_generic():
        raise RuntimeError(f'this processor does not run what is compiled for {generic()[0]}')
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = generic()
    if cpu_target.target_context.codegen().magic_tuple()[1:] != generic():
        raise RuntimeError('a kernel was imported before')
