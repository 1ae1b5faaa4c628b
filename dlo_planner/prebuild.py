# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Compile ahead: fill the folder of the package from which every process can load kernels.

`make`, `pip install` and `colcon build` do it. What lies there is valid for these sources, these
versions of Python, numba, llvmlite and numpy, and any processor of this kind. What is not valid is
not found, and compiled when it is first needed. A second run compiles only what has changed.

One process does it: most of the time goes to one large kernel and what it calls, and two processes
compile much of that twice (185 s of work in place of 130).
"""

import argparse
import sys
from contextlib import suppress
from pathlib import Path
from time import monotonic


def main(args: list[str] | None = None) -> int:
    """Fill the folder; return the exit status.

    Parameters
    ----------
    args : list of str, optional
        Arguments of the command line. If None, sys.argv.
    """
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
    """Compile all kernels for any processor of this kind; return the folder they are in.

    Only in a process that has not imported a kernel yet, and that does nothing else.

    Parameters
    ----------
    into : Path, optional
        Folder of such folders, one for each Python. If None, that of the package.

    Raises
    ------
    RuntimeError
        This processor is older than what the kernels are compiled for, or a kernel has been
        imported already.
    """
    from dlo_planner.kernels import cache, files, folders, processor  # noqa: PLC0415
    folder = folders.IN_PACKAGE if into is None else into / folders.IN_PACKAGE.name
    folder.mkdir(parents=True, exist_ok=True)
    folders.use_only(folder)
    processor.compile_generic()
    from dlo_planner import exercises  # noqa: PLC0415
    for exercise in exercises.ALL:
        exercise()
    kept = files.current_stems(cache.KERNELS.values())
    for path in folder.iterdir():
        if path.name.rsplit('-', 1)[0] not in kept:
            with suppress(FileNotFoundError):  # another process does the same
                path.unlink()
    return folder


if __name__ == '__main__':
    sys.exit(main())
