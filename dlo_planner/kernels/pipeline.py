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
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import (
    AnalysisPass,
    FunctionPass,
    PassManager,
    register_pass,
)
from numba.core.dispatcher import Dispatcher, _FunctionCompiler
from numba.core.runtime.context import NRTContext

from dlo_planner.kernels.cache import KERNELS
from dlo_planner.kernels.fingerprint import Unseen
from dlo_planner.kernels.lowering import Legalize, Lowering, holds_counts
from dlo_planner.kernels.shortcuts import SHORTCUTS

_UNROLLED = {'literally', 'literal_unroll'}
# What no kernel has: `with` blocks and literal_unroll; and what is only written down for people.
_NEVER: tuple[type, ...] = (
    untyped_passes.WithLifting, untyped_passes.FindLiterallyCalls, untyped_passes.LiteralUnroll,
    untyped_passes.LiteralPropagationSubPipelinePass, typed_passes.AnnotateTypes,
    typed_passes.DumpParforDiagnostics)
_OF_CLOSURES = (untyped_passes.InlineClosureLikes, untyped_passes.MakeFunctionToJitFunction)
_LISTS = ('BUILD_LIST', 'LIST_APPEND', 'MAKE_FUNCTION')
# What returns a part of what it takes, which keeps its owner.
_BORROWING = ('getattr', 'static_getitem', 'build_tuple', 'exhaust_iter', 'getiter', 'iternext',
              'pair_first', 'pair_second', 'cast', 'phi')
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
        with suppress(Unseen, KeyError):  # what is in no file needs no name
            state.func_id.unique_id = int(KERNELS[state.func_id.func].sources[:16], 16)
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class _CountNothing(AnalysisPass):  # type: ignore[misc]
    """Leave out counts of references where a kernel neither makes nor returns an array.

    Who calls it holds all that it sees, as long as it runs.
    """

    _name = 'dlo_planner_count_nothing'

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        counts = state.func_ir.is_generator or holds_counts(state.targetctx, state.return_type)
        if not counts and not any(_makes(state)):
            context = state.targetctx.subtarget(enable_nrt=False)
            context.nrt = NRTContext(context, True)  # Records are read through it
            state.targetctx = context
        return False


def _makes(state: Any) -> Iterator[bool]:
    """Yield for each operation whether it may make an array, or take a count of one."""
    for block in state.func_ir.blocks.values():
        for one in block.find_insts(ir.Assign):
            if not isinstance(one.value, ir.Expr) or one.value.op in _BORROWING:
                continue
            if one.value.op == 'getitem':
                yield holds_counts(state.targetctx, state.typemap[one.value.index.name])
            elif one.value.op != 'call' or not _is_harmless(state, one.value.func.name):
                yield any(holds_counts(state.targetctx, state.typemap[name.name])
                          for name in (one.target, *one.value.list_vars()))
            else:
                yield holds_counts(state.targetctx, state.typemap[one.target.name])


def _is_harmless(state: Any, name: str) -> bool:
    """Whether a function takes no counts of its arguments: another kernel, or `len`."""
    kind = state.typemap[name]
    return isinstance(kind, types.Dispatcher) or getattr(kind, 'typing_key', None) is len


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


class _Passes(PassManager):  # type: ignore[misc]
    """Passes without numba's records of them, and without its checks of its own passes."""

    def _runPass(self, index: int, one: Any, state: Any) -> None:  # noqa: N802
        one.analysis = self._analysis
        one.run_initialization(state)
        one.run_pass(state)
        one.run_finalizer(state)


_OWN = {typed_passes.NopythonRewrites: _RewriteArrays, typed_passes.IRLegalization: Legalize,
        typed_passes.NativeLowering: Lowering}


class Pipeline(CompilerBase):  # type: ignore[misc]
    """The compiler of a kernel."""

    def define_pipelines(self) -> list[Any]:
        """Return the one way there is."""
        whole = DefaultPassBuilder.define_nopython_pipeline(self.state)
        left_out = _left_out(self.state.func_id.func)
        passes = _Passes('dlo_planner')
        for one, description in whole.passes:
            if one is typed_passes.IRLegalization:
                passes.add_pass(_CountNothing, 'count nothing')
            if one not in left_out:
                passes.add_pass(_OWN.get(one, one), description)
            if one is typed_passes.NopythonTypeInference:
                passes.add_pass(_NameBySources, 'name by sources')
        passes.finalize()
        return [passes]


def _left_out(function: FunctionType) -> tuple[type, ...]:
    """Return the passes that find nothing in a function."""
    code = function.__code__
    used = {dis.opname[one] for one in set(code.co_code[::2])}
    if not _UNROLLED.isdisjoint(code.co_names + code.co_freevars) or 'BEFORE_WITH' in used:
        return ()
    left_out = _NEVER if used.intersection(_LISTS) else _NEVER + _OF_CLOSURES
    if function not in KERNELS:
        return left_out
    called = (function.__globals__.get(name) for name in code.co_names)
    if not any(isinstance(one, Dispatcher) and 'inline' in one.targetoptions for one in called):
        left_out += (untyped_passes.InlineInlinables,)
    return left_out


def _compile_core(self: Any, args: Any, returned: Any) -> Any:
    """Compile what numba writes in Python, for kernels to call, as if it were a kernel."""
    if self.pipeline_class is not Compiler or not self.targetoptions.get('no_cpython_wrapper'):
        return _core(self, args, returned)
    self.pipeline_class = Pipeline
    before, self.targetoptions = self.targetoptions, self.targetoptions | {'no_cfunc_wrapper': True}
    try:
        return _core(self, args, returned)
    finally:
        self.pipeline_class, self.targetoptions = Compiler, before


_core = _FunctionCompiler._compile_core
SHORTCUTS.append((_FunctionCompiler, '_compile_core', _compile_core))
