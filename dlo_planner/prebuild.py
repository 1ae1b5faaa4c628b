# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Compile ahead: fill the folder of the package from which every process can load kernels.

`make`, `pip install` and `colcon build` do it. What lies there is valid for these sources, these
versions of Python, numba, llvmlite and numpy, and any processor of this kind. What is not valid is
not found, and compiled when it is first needed. A second run compiles only what has changed.

Two processes do it, the longest exercise first. What both need at once is compiled twice, which is
less than one of them would wait for the other.
"""

import argparse
import gc
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import monotonic

from dlo_planner.signals import leave_to_parent

_PROCESSES = 2


def main(args: list[str] | None = None) -> int:
    """Fill the folder; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m dlo_planner.prebuild', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--into', type=Path, metavar='FOLDER',
                        help='the folder `compiled` of a package (that of the imported one)')
    given = parser.parse_args(args)
    from dlo_planner.kernels import COMPILED  # noqa: PLC0415  (it may warn)
    if not COMPILED:
        print('dlo_planner: without numba there is nothing to compile', file=sys.stderr)
        return 0
    print('dlo_planner: compiling the solver (minutes, where it has not been done) ...', flush=True)
    started = monotonic()
    files = list(prebuild(given.into).iterdir())
    print(f'dlo_planner: {len(files)} kernels, {sum(one.stat().st_size for one in files) / 1e6:.0f}'
          f' MB, after {monotonic() - started:.0f} s')
    return 0


def prebuild(into: Path | None = None) -> Path:
    """Compile all kernels for any processor of this kind; return the folder they are in."""
    from dlo_planner import exercises  # noqa: PLC0415
    from dlo_planner.kernels import files  # noqa: PLC0415
    folder = files.IN_PACKAGE if into is None else into / files.IN_PACKAGE.name
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(_PROCESSES, get_context('spawn'), leave_to_parent) as pool:
        use = partial(_use, folder)
        kept = set().union(*pool.map(use, range(len(exercises.ALL))))
    for path in folder.iterdir():
        if path.name.rsplit('-', 1)[0] not in kept:
            with suppress(FileNotFoundError):  # another process does the same
                path.unlink()
    return folder


def _untimed(_kind: str, _callback: Callable[[float], None]) -> AbstractContextManager[None]:
    """Return a context that times nothing.

    numba has one for each kernel that waits for what it calls to be compiled, and tells all of them
    of each call of LLVM: that was 8 % of the time.
    """
    return nullcontext()


def _use(folder: Path, exercise: int) -> set[str]:
    """Keep in a folder what an exercise needs; return how the names of valid files begin."""
    from numba.core import event  # noqa: PLC0415

    from dlo_planner.kernels import dispatcher, files  # noqa: PLC0415
    gc.set_threshold(200_000, 50, 1000)  # most of what a compiler makes stays: a fifth less time
    event.install_timer = _untimed
    files.use_only(folder)
    files.compile_generic()
    from dlo_planner import exercises  # noqa: PLC0415
    exercises.ALL[exercise]()
    return files.current_stems(dispatcher.KERNELS.values())


if __name__ == '__main__':
    sys.exit(main())
