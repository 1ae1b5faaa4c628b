# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands for parts of numba while a kernel is compiled: the same results in less time."""

from __future__ import annotations

import dis
from collections.abc import Callable
from functools import cache, lru_cache
from hashlib import sha256
from typing import Any

from numba.core import base, config, event, ir, itanium_mangler, transforms, types
from numba.core.base import BaseContext
from numba.core.codegen import CPUCodegen
from numba.core.datamodel.models import DataModel
from numba.core.errors import NumbaError
from numba.core.event import _registered
from numba.core.interpreter import Interpreter
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.runtime.context import NRTContext
from numba.core.typeinfer import ConstraintNetwork
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext as TypingContext
from numba.extending import overload
from numba.np import arrayobj

_resolve = BaseFunction.get_call_type
_start, _end = event.start_event, event.end_event
_post_process = PostProcessor.run
_resolved: dict[tuple[Any, ...], Any] = {}


def _call_type(self: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """Resolve the same operation on the same types once in a process."""
    if kws or self.__class__ is not types.Function:
        return _resolve(self, context, args, kws)
    key = (self, context, args)
    signature = _resolved.get(key)
    if signature is None:
        signature = _resolve(self, context, args, kws)
        if all(one.is_precise() for one in args):
            _resolved[key] = signature
    return signature


def _started(kind: str, data: object = None) -> None:
    """Tell those who listen that something begins, if there are any."""
    if _registered.get(kind):
        _start(kind, data)


def _ended(kind: str, data: object = None, exc_details: Any = None) -> None:
    """Tell those who listen that something ends, if there are any."""
    if _registered.get(kind):
        _end(kind, data, exc_details)


def _post_processed(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Find how long variables live only where that is asked for."""
    function = self.func_ir
    if function.is_generator:
        _post_process(self, emit_dels, extend_lifetimes)
        return
    function.blocks = transforms.canonicalize_cfg(function.blocks)
    function.variable_lifetime = VariableLifetime(function.blocks)  # it computes on demand
    function.generator_info = None
    if emit_dels:
        self._insert_var_dels(extend_lifetimes=extend_lifetimes)


def _variables(self: Any, value: Any) -> list[Any]:
    """Return the variables in a part of an instruction."""
    kind = value.__class__
    if kind is ir.Var:
        return [value]
    if kind in _WITHOUT_VARIABLES:
        return []
    if kind is dict:
        value = value.values()
    elif kind is not tuple and kind is not list:
        return value.list_vars() if isinstance(value, ir.Inst) else []
    return [one for part in value if part.__class__ not in _WITHOUT_VARIABLES
            for one in _variables(self, part)]


_WITHOUT_VARIABLES = frozenset((str, int, float, bool, type(None), ir.Loc))


class _ForCounts:
    """Passes that are run for the sake of counts of references, where there are any."""

    def __init__(self, passes: Any) -> None:
        self._passes = passes

    def run(self, module: Any, *builder: Any) -> None:
        """Change a module in place."""
        if any(one.name.startswith('NRT_') for one in module.functions):
            self._passes.run(module, *builder)


def _module_pass_manager(self: Any, **options: Any) -> Any:
    """Bring counts together, so that they cancel, only where there are counts."""
    passes = _passes_of(self, **options)
    if options.get('cost') != 'cheap':
        return passes
    return _ForCounts(passes[0]), passes[1]


_passes_of = CPUCodegen._module_pass_manager


_sizes: dict[int, int] = {}  # of the registries of each context


def _refreshed(self: Any) -> None:
    """Take what was declared since; all modules that declare were imported before any kernel."""
    known = self._registries
    size = sum(len(getattr(one, name)) for one in known for name in known[one].registry_items)
    if _sizes.get(id(known)) != size:
        for one in tuple(known):
            self.install_registry(one)
        _sizes[id(known)] = size
    if isinstance(self, BaseContext):
        self.typing_context.refresh()


_takes_place, _check = base._has_loc, CPUCodegen._check_llvm_bugs


def _has_loc(function: Any) -> bool:
    """Whether a function takes a place in the sources."""
    code = getattr(function, '__code__', None)
    if code is None or hasattr(function, '__wrapped__'):
        takes: bool = _takes_place(function)
        return takes
    return 'loc' in code.co_varnames[:code.co_argcount + code.co_kwonlyargcount]


@cache
def _check_llvm_bugs(self: Any) -> None:
    """Look for mistakes of LLVM once."""
    _check(self)


def _propagated(self: Any, inference: Any) -> list[Exception]:
    """Infer types; where that fails, again, with a record of what failed and was warned of."""
    try:
        for constraint in self.constraints:
            constraint(inference)
    except NumbaError:
        errors: list[Exception] = _propagate(self, inference)
        return errors
    return []


_propagate = ConstraintNetwork.propagate


def _patched(self: Any, patches: list[Any], function: Any) -> Any:
    """Mend what bytecode makes of lists, dictionaries and `with` blocks, where there are any."""
    if _MENDED.isdisjoint(_operations(self.func_id.func.__code__)):
        return function
    return _patch(self, patches, function)


_patch = Interpreter.post_process


def _counters(self: Any, builder: Any, kind: Any, value: Any) -> list[tuple[Any, Any]]:
    """Write what finds the counters in a value, not what reads all else that is in it."""
    models = self._context.data_model_manager
    model = models[kind]
    found = [(kind, model.get_nrt_meminfo(builder, value))] if model.has_nrt_meminfo() else []
    for inner, read in model.traverse(builder):
        if models[inner].contains_nrt_meminfo():
            found += _counters(self, builder, inner, read(value))
    return found


_MENDED = frozenset(('LIST_TO_TUPLE', 'LIST_EXTEND', 'BUILD_LIST', 'BUILD_MAP', 'DICT_UPDATE',
                     'DICT_MERGE', 'BUILD_CONST_KEY_MAP', 'BEFORE_WITH', 'CALL_FUNCTION_EX',
                     'CALL_INTRINSIC_1', 'PUSH_EXC_INFO'))


def _operations(code: Any) -> set[str]:
    return {dis.opname[one] for one in set(code.co_code[::2])}


def _equal(self: Any, other: Any) -> bool:
    """Compare types; most of those that are equal are the same object."""
    return self is other or self.__class__ is other.__class__ and self.key == other.key


def _holds_counts(self: Any) -> bool:
    """Find once for each model whether what it describes holds references that are counted."""
    holds: bool | None = self.__dict__.get('_holds_counts')
    if holds is None:
        holds = self._holds_counts = _contains(self)
    return holds


_contains = DataModel.contains_nrt_meminfo


@lru_cache(maxsize=None, typed=True)
def _mangled(value: object) -> str:
    """Write a type in the name of what is compiled: those of many words by a digest of them."""
    name: str = _mangle(value)
    if len(name) <= _SHORT:
        return name
    return f'{_SHORT}T{sha256(name.encode()).hexdigest()[:_SHORT - 1]}'


_mangle, _SHORT = itanium_mangler.mangle_type_or_value, 40


def _mismatch(given: object, part: object) -> None:
    """Say that an array does not fit the part of an array that is to hold it."""


@overload(_mismatch)  # type: ignore[untyped-decorator]  # numba is not annotated
def _of_mismatch(given: object, part: object) -> Callable[..., None]:
    """Say so in constant words: numba's own need half of what it knows of strings."""
    def mismatch(given: object, part: object) -> None:
        raise ValueError('an array does not fit the part of an array that is to hold it')

    return mismatch


def _pass_builder(self: Any, **options: Any) -> Any:
    """Optimize as LLVM does at its first level: kernels came out as quick as at the third."""
    return _builder(self, **{'opt': min(1, config.OPT)} | options)


_builder = CPUCodegen._pass_builder

SHORTCUTS: list[tuple[Any, str, Callable[..., Any]]] = [  # whose, what, and what stands for it
    (BaseFunction, 'get_call_type', _call_type),
    (event, 'start_event', _started),
    (event, 'end_event', _ended),
    (PostProcessor, 'run', _post_processed),
    (ir.Inst, '_rec_list_vars', _variables),
    (BaseContext, 'refresh', _refreshed),
    (TypingContext, 'refresh', _refreshed),
    (CPUCodegen, '_module_pass_manager', _module_pass_manager),
    (CPUCodegen, '_pass_builder', _pass_builder),
    (types.Type, '__eq__', _equal),
    (DataModel, 'contains_nrt_meminfo', _holds_counts),
    (itanium_mangler, 'mangle_type_or_value', _mangled),
    (arrayobj, 'raise_with_shape_context', _mismatch),
    (CPUCodegen, '_check_llvm_bugs', _check_llvm_bugs),
    (base, '_has_loc', _has_loc),
    (ConstraintNetwork, 'propagate', _propagated),
    (Interpreter, 'post_process', _patched),
    (NRTContext, 'get_meminfos', _counters)]
