# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pools of processes that have lost a worker: what they do not say in public.

When a worker dies, a pool ends the others and says so of all that it had. It may fail to: a result
of which half was written is waited for without end, and what is submitted at that very moment is
forgotten.
"""

from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import suppress
from typing import Any


def like(pool: Any) -> ProcessPoolExecutor:
    """Return a new pool that is made as another one was."""
    options = {name: getattr(pool, f'_{name}') for name in (
        'max_workers', 'mp_context', 'initializer', 'initargs')}
    return ProcessPoolExecutor(**options)


def has_lost_a_worker(executor: Executor | None) -> bool:
    """Return whether an executor is a pool that is broken, or is about to find out that it is."""
    if not isinstance(executor, ProcessPoolExecutor):
        return False
    return bool(getattr(executor, '_broken', False)) or any(
        one.exitcode not in (None, 0) for one in _workers(executor))


def leave(pool: ProcessPoolExecutor) -> None:
    """End the workers of a broken pool that are left, and what waits for them in this process."""
    writer = getattr(getattr(pool, '_result_queue', None), '_writer', None)
    for one in _workers(pool):
        with suppress(OSError, ValueError):  # it has ended by itself
            one.terminate()
    if writer is not None:
        with suppress(OSError):
            writer.close()  # who waits for the other half of a result reads the end of it


def _workers(pool: Any) -> list[Any]:
    """Return the Processes of a pool; its own thread may change them meanwhile."""
    return list((getattr(pool, '_processes', None) or {}).values())
