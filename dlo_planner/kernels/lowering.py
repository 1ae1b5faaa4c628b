# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a kernel becomes code for LLVM: as by numba, without what serves counts of references.

numba deletes each variable after its last use: it reads the variable, counts references down where
there are any, and fills it with zeros. It reads what a variable held before it writes it, too. Of
numbers, Records and tuples of them there is nothing to count: LLVM finds that none of this matters,
after it was written, printed, parsed and optimized. Here it is not written.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from numba.core import cgutils, typed_passes, types
from numba.core.compiler_machinery import register_pass
from numba.core.errors import LoweringError, new_error_context
from numba.core.ir_utils import enforce_no_dels, enforce_no_phis, get_definition, guard
from numba.core.lowering import BaseLower, Lower
from numba.core.postproc import PostProcessor
from numba.np.arrayobj import load_item, store_item


def holds_counts(context: Any, kind: Any) -> bool:
    """Whether values of a type hold references that are counted."""
    holds: bool = context.data_model_manager[kind].contains_nrt_meminfo()
    return holds


@register_pass(mutates_CFG=False, analysis_only=True)
class Legalize(typed_passes.IRLegalization):  # type: ignore[misc]  # numba is not annotated
    """Have variables deleted after their last use where references are counted."""

    _name = 'dlo_planner_legalize'

    def run_pass(self, state: Any) -> bool:
        """Change what is compiled in place."""
        if state.targetctx.enable_nrt or state.flags.debuginfo:
            changed: bool = super().run_pass(state)
            return changed
        enforce_no_phis(state.func_ir)
        enforce_no_dels(state.func_ir)
        PostProcessor(state.func_ir).run()
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(typed_passes.NativeLowering):  # type: ignore[misc]
    """Write a function for LLVM; as numba does where a debugger is to find all variables."""

    _name = 'dlo_planner_lowering'
    lowering_class: Any = Lower

    def run_pass(self, state: Any) -> bool:
        """Change what is compiled in place."""
        if not state.flags.debuginfo and not state.func_ir.is_generator:
            self.lowering_class = _Lower
        changed: bool = super().run_pass(state)
        return changed


class _Lower(Lower):  # type: ignore[misc]
    """What writes a function."""

    _disable_sroa_like_opt = False  # numba looks it up at each variable

    def lower_block(self, block: Any) -> None:
        """Write a block; what fails is told with its place."""
        self.pre_block(block)
        try:
            for self.loc, one in ((one.loc, one) for one in block.body):  # noqa: B020
                self.lower_inst(one)
        except Exception:
            with new_error_context('lowering "{inst}" at {loc}', inst=one, loc=self.loc,
                                   errcls_=lambda text: LoweringError(text, loc=self.loc)):
                raise
        self.post_block(block)

    def pre_block(self, block: Any) -> None:
        """Prepare; a kernel that catches nothing needs no preparation."""
        if self.func_ir.func_id.func.__code__.co_exceptiontable:
            super().pre_block(block)
        else:
            BaseLower.pre_block(self, block)
            self._cur_ir_block = block

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Write a value to a variable."""
        kind = self.typeof(name)
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        elif argidx is None and self._counts(kind):
            super().storevar(value, name)
        else:
            self._alloca_var(name, kind)
            self.builder.store(value, self.varmap[name])

    def delvar(self, name: str) -> None:
        """Delete a variable."""
        if self._counts(self.typeof(name)):
            super().delvar(name)

    def alloca_lltype(self, name: str, lltype: Any, datamodel: object = None) -> Any:
        """Return the place of a variable."""
        return cgutils.alloca_once(self.builder, lltype, name=name, zfill=False)

    def incref(self, typ: Any, val: Any) -> None:
        """Count references up."""
        if self._counts(typ):
            super().incref(typ, val)

    def decref(self, typ: Any, val: Any) -> None:
        """Count references down."""
        if self._counts(typ):
            super().decref(typ, val)

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        """Return the result of an operation."""
        if expr.op == 'getiter' and self._counts_up(expr.value):
            return self._counted(resty, self.loadvar(expr.value.name))
        return super().lower_expr(resty, expr)

    def _counts_up(self, value: Any) -> bool:
        """Whether a value is `range` of one or two numbers."""
        if not isinstance(self.typeof(value.name), types.RangeType):
            return False
        made = guard(get_definition, self.func_ir, value)
        return (getattr(made, 'op', '') == 'call' and not made.kws and not made.vararg
                and len(made.args) < 3
                and getattr(self.typeof(made.func.name), 'typing_key', None) is range)

    def _counted(self, kind: Any, span: Any) -> Any:
        """Return what a loop by ones goes through; numba's own finds the number of any steps."""
        build = self.builder
        start, stop = (build.extract_value(span, axis) for axis in range(2))
        number, nothing = build.sub(stop, start), start.type(0)
        number = build.select(build.icmp_signed('>', number, nothing), number, nothing)
        at, left = (cgutils.alloca_once(build, start.type) for _ in range(2))
        build.store(start, at)
        build.store(number, left)
        return cgutils.make_anonymous_struct(build, (at, stop, start.type(1), left),
                                             self.context.get_value_type(kind))

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Return an item, or a part, of what has parts."""
        kind, place = self.typeof(value.name), self._place(value.name, index.name)
        if place is None:
            return super().lower_getitem(resty, expr, value, index, signature)
        item = load_item(self.context, self.builder, kind, place)
        return self.context.cast(self.builder, item, kind.dtype, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Write an item, or a part, of what has parts."""
        kind, place = self.typeof(target_var.name), self._place(target_var.name, index_var.name)
        if place is None:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        value, given = self.loadvar(value_var.name), self.typeof(value_var.name)
        for wanted in (signature.args[2], kind.dtype):
            value, given = self.context.cast(self.builder, value, given, wanted), wanted
        return store_item(self.context, self.builder, kind, value, place)

    def _place(self, name: str, index: str) -> Any:
        """Return the address of one number in an array, None if an index is not of one."""
        array, kinds = self.typeof(name), self.typeof(index)
        several = isinstance(kinds, types.BaseTuple)
        kinds = kinds.types if several else (kinds,)
        if (not isinstance(array, types.Array) or array.ndim != len(kinds)
                or not isinstance(array.dtype, (types.Number, types.Boolean))
                or not all(isinstance(one, types.Integer) for one in kinds)
                or self.context.enable_boundscheck):
            return None
        given = self.loadvar(index)
        indices = [self._from_start(kind, self.builder.extract_value(given, axis) if several
                                    else given, name, axis) for axis, kind in enumerate(kinds)]
        data, build = self._of_array(name, 'data'), self.builder
        if array.layout == 'A':
            strides = [self._of_array(name, 'strides', axis) for axis in range(array.ndim)]
            return cgutils.pointer_add(build, data, reduce(build.add, map(
                build.mul, strides, indices)))
        sizes = [self._of_array(name, 'shape', axis) for axis in range(array.ndim)]
        if array.layout == 'F':
            indices, sizes = indices[::-1], sizes[::-1]
        offset = indices[-1]
        for axis, one in enumerate(indices[:-1]):
            offset = build.add(offset, build.mul(one, reduce(build.mul, sizes[axis + 1:])))
        return build.gep(data, [offset])

    def _from_start(self, kind: Any, given: Any, name: str, axis: int) -> Any:
        """Return an index from the start for one that may be from the end."""
        if not kind.signed:
            return self.context.cast(self.builder, given, kind, types.uintp)
        given = self.context.cast(self.builder, given, kind, types.intp)
        if isinstance(kind, types.IntegerLiteral) and kind.literal_value >= 0:
            return given
        negative = self.builder.icmp_signed('<', given, given.type(0))
        return self.builder.select(
            negative, self.builder.add(given, self._of_array(name, 'shape', axis)), given)

    def _of_array(self, name: str, field: str, *axis: int) -> Any:
        """Return what is in the field of an array."""
        model = self.context.data_model_manager[self.typeof(name)]
        where = (model.get_field_position(field), *axis)
        if name in self._blk_local_varmap:
            return self.builder.extract_value(self._blk_local_varmap[name], where)
        return self.builder.load(cgutils.gep_inbounds(self.builder, self.getvar(name), 0, *where))

    def _counts(self, kind: Any) -> bool:
        return self.context.enable_nrt and holds_counts(self.context, kind)
