# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What numba does while it compiles a kernel, and need not do: its ways are changed for so long.

Machine code is made of each function, though most are copied into those that call them; here only
of what is called: `Library.emit`. Python looks for cycles among millions of objects that all stay;
here it does not. What else is left out stands in `shortcuts`.

Of what LLVM does only the level is another (`shortcuts`): without its first round over each
function alone, loops over constants came out up to 1.7 times slower.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target

from dlo_planner.kernels.shortcuts import SHORTCUTS

_ENVIRONMENT = '_ZN08NumbaEnv'  # how numba's names of what holds a function's constants begin
_depth: list[None] = []


@contextmanager
def compiling() -> Iterator[None]:
    """Compile in less time than numba, within; other threads wait."""
    with global_compiler_lock:
        _depth.append(None)
        try:
            if len(_depth) > 1:
                yield
                return
            with _lean():
                yield
        finally:
            _depth.pop()


@contextmanager
def _lean() -> Iterator[None]:
    context, collects = cpu_target.target_context, gc.isenabled()
    _prepare(context)
    code = context.codegen()
    gc.disable()
    code.create_library = partial(Library, code)
    before = [getattr(owner, name) for owner, name, _ in SHORTCUTS]
    for owner, name, shortcut in SHORTCUTS:
        setattr(owner, name, shortcut)
    try:
        yield
    finally:
        del code.create_library  # that of its class is there again
        for (owner, name, _), one in zip(SHORTCUTS, before, strict=True):
            setattr(owner, name, one)
        if collects:
            _keep_out_of_sight()
            gc.enable()


@cache
def _prepare(context: Any) -> None:
    """Have numba make what all code calls that allocates, and know what it offers."""
    context.refresh()


def _keep_out_of_sight() -> None:
    """Have Python not look for cycles among what was made, before it looks at all there is."""
    if not gc.get_freeze_count():
        gc.freeze()
        gc.unfreeze()  # the objects are old ones now


class _Defined:
    """A module without the functions that it only declares."""

    module: Any

    def __init__(self, module: Any) -> None:
        self.__dict__['module'] = module

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self.module, name, value)

    @property
    def functions(self) -> Iterator[Any]:
        """Those that are not only declared."""
        return (one for one in self.module.functions if not one.is_declaration)


class Library(JITCodeLibrary):  # type: ignore[misc]  # numba is not annotated
    """Code of which machine code is made when it is called, not before."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self._emitted = False
        self._environments: dict[str, Any] = {}

    @property
    def codegen(self) -> Any:
        """What takes the environments of functions."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Take the environment of a function, for when there is machine code that reads it."""
        if not self._emitted:
            self._environments[name] = environment
        else:
            self._codegen.set_env(name, environment)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimize each function alone that is more than declared."""
        super()._optimize_functions(_Defined(ll_module))

    def emit(self) -> None:
        """Make the machine code, where it has not been made."""
        self._ensure_finalized()
        if self._emitted:
            return
        self._dynamic_globals.clear()  # they are found again
        super()._finalize_final_module()
        self._emitted = True
        for one in self._final_module.global_variables:
            if one.name.startswith(_ENVIRONMENT):
                self._environments.setdefault(one.name, lookup_environment(one.name))
        for name, environment in self._environments.items():
            if environment is not None:
                self.set_env(name, environment)

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of a function; 0 if it is not in this library."""
        self._ensure_finalized()
        if not self._emitted and all(one.name != name for one in self.get_defined_functions()):
            return 0
        self.emit()
        address: int = super().get_pointer_to_function(name)
        return address

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """Return the machine code, none where none was made, and what is copied into others."""
        if not self._emitted:
            return self.name, 'object', (b'', self._get_module_for_linking().as_bitcode())
        state: tuple[str, str, tuple[bytes, bytes]] = super().serialize_using_object_code()
        return state

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True
