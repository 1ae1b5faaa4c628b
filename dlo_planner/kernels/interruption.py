# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a kernel that may be long learns that it is to end: it calls back to Python now and then.

What the check of `progress.interrupted_by` raises cannot go through compiled code. It is kept, the
kernel ends as one whose steps are used up, and `progress.uninterrupted` raises it in place of what
the kernel returned.
"""

from ctypes import CFUNCTYPE, c_int32, c_void_p, cast
from functools import partial
from operator import methodcaller

from dlo_planner.kernels import COMPILED
from dlo_planner.progress import ASKED

_SYMBOL = 'dlo_planner_interrupted'
# All of it is C but for the check itself: where there is none, a signal waits for the kernel's end.
_ask = partial(methodcaller('send', None), ASKED)


def interrupted() -> bool:
    """Return whether the computation of this thread is to end.

    It takes Python's lock: kernels call it about every ten milliseconds.
    """
    return bool(_ask())


if COMPILED:
    import llvmlite.binding as llvm
    from numba.core import types
    from numba.extending import overload

    _called = CFUNCTYPE(c_int32)(_ask)
    llvm.add_symbol(_SYMBOL, cast(_called, c_void_p).value)
    _interrupted = types.ExternalFunction(_SYMBOL, types.int32())
    interrupted.__fingerprint__ = lambda: _SYMBOL  # type: ignore[attr-defined]

    @overload(interrupted)
    def _written():  # type: ignore[no-untyped-def]  # numba compares signatures
        return lambda: _interrupted() != 0
