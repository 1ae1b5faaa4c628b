# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that make no array need not count who refers to one; small arrays are on the stack.

numba counts references to arrays while a kernel runs, atomically. A row `x[a]` that is looked at in
a loop is counted up and down; where LLVM cannot see both at once, that costs more than the
arithmetic: among many contacts it was 45 % of the time. A kernel that is given all of its arrays
and returns none holds nothing that could be freed while it runs, for its caller does. There the
counts are left out. Records are alike: their fields never change.

An `np.empty(3)` that is refilled for each point takes longer than what is done with it: a call of
the allocator, one to free it, and counts between. Where a kernel returns nothing that could hold
it, an array of a few numbers whose shape is written down, made outside of loops, is on the stack.
It lives as long as the kernel runs, and nobody owns it, so that to count it does nothing.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba.core import cgutils, ir, types
from numba.core.analysis import compute_cfg_from_blocks
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.cpu import CPUContext
from numba.core.ir_utils import find_callname, get_definition, guard, mk_unique_var
from numba.core.runtime.context import NRTContext
from numba.core.typed_passes import NopythonRewrites
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

# What an expression of numba's may be that gives a view or a part of what there is
_VIEWS = ('getattr', 'getitem', 'static_getitem', 'cast', 'exhaust_iter', 'pair_first',
          'iternext', 'getiter', 'phi', 'build_tuple')
_FEW = 256  # numbers of an array on the stack, at most: 2 kB


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


@register_pass(mutates_CFG=False, analysis_only=False)
class _LeaveOutCounts(FunctionPass):  # type: ignore[misc]
    """Tell numba to count no references, where all arrays belong to the caller."""

    _name = 'leave_out_counts'

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Look at all values that a kernel makes."""
        if _counts(state, state.return_type):
            return False
        changed = _put_on_stack(state)
        if all(_is_borrowed(state, statement) for block in state.func_ir.blocks.values()
               for statement in block.body):
            state.targetctx = _without_counts(state.targetctx)
        return changed


def _put_on_stack(state: Any) -> bool:
    """Make small arrays on the stack that a kernel makes at most once; return if there are any.

    In a loop the one before may still be wanted, as where two are exchanged.
    """
    blocks, found = state.func_ir.blocks, False
    repeated = {label for loop in compute_cfg_from_blocks(blocks).loops().values()
                for label in loop.body}
    for label in blocks.keys() - repeated:
        body = []
        for statement in blocks[label].body:
            make = _maker_on_stack(state, statement)
            if make is not None:
                found = True
                name = mk_unique_var('$on_stack')
                maker = ir.Var(blocks[label].scope, name, statement.loc)
                state.typingctx.refresh()  # they look for what is new
                state.targetctx.refresh()
                state.typemap[name] = kind = state.typingctx.resolve_value_type(make)
                body.append(ir.Assign(ir.Global(name, make, statement.loc), maker, statement.loc))
                statement.value = ir.Expr.call(maker, (), (), statement.loc)
                state.calltypes[statement.value] = kind.get_call_type(state.typingctx, (), {})
            body.append(statement)
        blocks[label].body = body
    return found


def _maker_on_stack(state: Any, statement: Any) -> Any:
    """Return what makes the array of a statement on the stack; None where that is not to be."""
    value = statement.value if isinstance(statement, ir.Assign) else None
    if not isinstance(value, ir.Expr) or value.op != 'call' or not value.args:
        return None
    called = guard(find_callname, state.func_ir, value)
    if called not in (('empty', 'numpy'), ('zeros', 'numpy')):
        return None
    shape, kind = _constant(state, value.args[0]), state.typemap[statement.target.name]
    shape = shape if isinstance(shape, tuple) else (shape,)
    if (not all(isinstance(n, int) and n > 0 for n in shape) or np.prod(shape) > _FEW
            or not isinstance(kind.dtype, types.Number | types.Boolean)):
        return None
    return _on_stack(kind, shape, called[0] == 'zeros')


def _constant(state: Any, variable: Any) -> Any:
    """Return the number, or tuple of numbers, that a variable stands for; None if it is no such."""
    known = guard(get_definition, state.func_ir, variable)
    if isinstance(known, ir.Const | ir.Global | ir.FreeVar):
        return known.value
    if isinstance(known, ir.Expr) and known.op == 'build_tuple':
        return tuple(_constant(state, item) for item in known.items)
    return None


@cache
def _on_stack(kind: Any, shape: tuple[int, ...], zeros: bool) -> Any:
    """Return the function of kernels that makes an array of a `kind` on the stack."""
    def write(context: Any, builder: Any, _: Any, __: Any) -> Any:
        number = context.get_data_type(kind.dtype)
        size, count = context.get_abi_sizeof(number), int(np.prod(shape))
        data = cgutils.alloca_once(builder, number, size=context.get_constant(types.intp, count))
        if zeros:
            cgutils.memset(builder, data, context.get_constant(types.intp, count * size), 0)
        array = context.make_array(kind)(context, builder)
        strides = [size * int(np.prod(shape[k + 1:])) for k in range(len(shape))]
        populate_array(array, data, [context.get_constant(types.intp, n) for n in shape],
                       [context.get_constant(types.intp, n) for n in strides],
                       context.get_constant(types.intp, size), None)
        return array._getvalue()

    def made_on_stack(_: Any) -> Any:
        return kind(), write

    return intrinsic(made_on_stack)


def _is_borrowed(state: Any, statement: Any) -> bool:
    """Whether a statement makes nothing that is counted, but for views of what there is."""
    if not isinstance(statement, ir.Assign):
        return True
    value = statement.value
    if not isinstance(value, ir.Expr) or value.op in _VIEWS:
        return True
    if value.op == 'call':
        if value.func.name.startswith('$on_stack'):
            return True
        if not _is_known(state.typemap[value.func.name]):
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
