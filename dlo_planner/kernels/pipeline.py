# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The passes of numba that a kernel goes through: those that can find something in it."""

from __future__ import annotations

import dis
from collections.abc import Iterator
from contextlib import suppress
from types import FunctionType
from typing import Any

from numba.core import ir, typed_passes, types, untyped_passes
from numba.core.compiler import Compiler, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, FunctionPass, PassManager, register_pass
from numba.core.dispatcher import Dispatcher

from dlo_planner.kernels.cache import KERNELS
from dlo_planner.kernels.fingerprint import Unseen

# What no kernel has: `with` blocks and literal_unroll; and what is only written down for people.
_NEVER: tuple[type, ...] = (
    untyped_passes.WithLifting, untyped_passes.FindLiterallyCalls, untyped_passes.LiteralUnroll,
    untyped_passes.LiteralPropagationSubPipelinePass, typed_passes.AnnotateTypes,
    typed_passes.DumpParforDiagnostics)
_OF_CLOSURES = (untyped_passes.InlineClosureLikes, untyped_passes.MakeFunctionToJitFunction)
_LISTS = ('BUILD_LIST', 'LIST_APPEND', 'MAKE_FUNCTION')
_RESULTS = ('binop', 'inplace_binop', 'unary', 'call')


@register_pass(mutates_CFG=False, analysis_only=True)
class _NameBySources(AnalysisPass):  # type: ignore[misc]  # numba is not annotated
    """Give the machine code a name that is the same in each process.

    Kernels that are kept in different files call each other by it.
    """

    _name = 'dlo_planner_name_by_sources'

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        with suppress(Unseen):  # what is in no file needs no name
            state.func_id.unique_id = int(KERNELS[state.func_id.func].sources[:16], 16)
        return False


@register_pass(mutates_CFG=True, analysis_only=False)
class _RewriteArrays(FunctionPass):  # type: ignore[misc]
    """Join the operations of an expression on arrays into a loop, if there is one."""

    _name = 'dlo_planner_rewrite_arrays'

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        if not any(isinstance(state.typemap[name], types.Array) for name in _results(state)):
            return False
        changed: bool = typed_passes.NopythonRewrites().run_pass(state)
        return changed


def _results(state: Any) -> Iterator[str]:
    """Yield the names of what operations and functions return."""
    for block in state.func_ir.blocks.values():
        for one in block.find_insts(ir.Assign):
            if isinstance(one.value, ir.Expr) and one.value.op in _RESULTS:
                yield one.target.name


class Pipeline(Compiler):  # type: ignore[misc]
    """The compiler of a kernel."""

    def define_pipelines(self) -> list[Any]:
        """Return the one way there is."""
        whole = DefaultPassBuilder.define_nopython_pipeline(self.state)
        left_out = _left_out(self.state.func_id.func)
        passes = PassManager('dlo_planner')
        for one, description in whole.passes:
            if one is typed_passes.NopythonRewrites:
                passes.add_pass(_RewriteArrays, description)
            elif one not in left_out:
                passes.add_pass(one, description)
            if one is typed_passes.NopythonTypeInference:
                passes.add_pass(_NameBySources, 'name by sources')
        passes.finalize()
        return [passes]


def _left_out(function: FunctionType) -> tuple[type, ...]:
    """Return the passes that find nothing in a function."""
    left_out = _NEVER
    if not any(one.opname in _LISTS for one in dis.get_instructions(function.__code__)):
        left_out += _OF_CLOSURES
    called = (function.__globals__.get(name) for name in function.__code__.co_names)
    if not any(isinstance(one, Dispatcher) and 'inline' in one.targetoptions for one in called):
        left_out += (untyped_passes.InlineInlinables,)
    return left_out
