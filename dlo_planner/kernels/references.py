# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that make no array need not count who refers to one.

numba counts references to arrays while a kernel runs, atomically. A row `x[a]` that is looked at in
a loop is counted up and down; where LLVM cannot see both at once, that costs more than the
arithmetic: among many contacts it was 45 % of the time. A kernel that is given all of its arrays
and returns none holds nothing that could be freed while it runs, for its caller does. There the
counts are left out. Records are alike: their fields never change.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.cpu import CPUContext
from numba.core.runtime.context import NRTContext
from numba.core.typed_passes import NopythonRewrites

# What an expression of numba's may be that gives a view or a part of what there is
_VIEWS = ('getattr', 'getitem', 'static_getitem', 'cast', 'exhaust_iter', 'pair_first',
          'iternext', 'getiter', 'phi', 'build_tuple')


class _Uncounted(NRTContext):  # type: ignore[misc]
    """What writes the code for arrays, without counts."""

    def incref(self, builder: Any, typ: Any, value: Any) -> None:
        """Write nothing."""

    def decref(self, builder: Any, typ: Any, value: Any) -> None:
        """Write nothing."""


class _Context(CPUContext):  # type: ignore[misc]
    """What writes all code for a processor, without counts."""

    @property
    def nrt(self) -> _Uncounted:
        """What writes the code for arrays."""
        return _Uncounted(self, self.enable_nrt)


def _without_counts(context: Any) -> Any:
    """Return the same context, which counts no references."""
    result = context.subtarget(cached_internal_func={})
    result.__class__ = _Context
    return result


class KernelCompiler(CompilerBase):  # type: ignore[misc]  # numba is not annotated
    """numba's compiler, which leaves out the counts where no array is made."""

    def define_pipelines(self) -> list[Any]:
        """Return what numba does, and one step more when all types are known."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_LeaveOutCounts, NopythonRewrites)
        passes.finalize()
        return [passes]


@register_pass(mutates_CFG=False, analysis_only=True)
class _LeaveOutCounts(AnalysisPass):  # type: ignore[misc]
    """Tell numba to count no references, where all arrays belong to the caller."""

    _name = 'leave_out_counts'

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Look at all values that a kernel makes."""
        if not _counts(state, state.return_type) and all(
                _is_borrowed(state, statement) for block in state.func_ir.blocks.values()
                for statement in block.body):
            state.targetctx = _without_counts(state.targetctx)
        return False


def _is_borrowed(state: Any, statement: Any) -> bool:
    """Whether a statement makes nothing that is counted, but for views of what there is."""
    if not isinstance(statement, ir.Assign):
        return True
    value = statement.value
    if not isinstance(value, ir.Expr) or value.op in _VIEWS:
        return True
    if value.op == 'call' and not _is_known(state.typemap[value.func.name]):
        return False
    return not _counts(state, state.typemap[statement.target.name])


def _is_known(called: Any) -> bool:
    """Whether a function that is called makes no arrays while it runs without counts."""
    if isinstance(called, (types.Dispatcher, types.NumberClass)):
        return True
    key = getattr(called, 'typing_key', None)
    return isinstance(key, np.ufunc) or getattr(key, '__module__', None) in ('math', 'builtins')


def _counts(state: Any, kind: Any) -> bool:
    """Whether references to a value of this type are counted."""
    return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())
