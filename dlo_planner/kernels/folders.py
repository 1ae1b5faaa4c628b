# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels lie: looked for in several folders, kept in the first that can be written.

In order: NUMBA_CACHE_DIR, the user's cache folder, one among temporary files that is the user's
alone, and the folder in the package that is filled when it is installed (`dlo_planner.prebuild`).
"""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numba

IN_PACKAGE = Path(__file__).parent.parent / 'compiled' / sys.implementation.cache_tag
_only: list[Path] = []
_ROOM = 512e6  # bytes of kernels of earlier sources, Pythons and versions of numba that are kept


class Folders(NamedTuple):
    """Where to look, in order; and where to write, None for nowhere."""

    read: tuple[Path, ...]
    write: Path | None


@cache
def folders() -> Folders:
    """Return the folders of this process; the one to write is made."""
    if _only:
        return Folders((_only[-1],), _only[-1])
    filled: list[Path] = []
    for parent in (_asked_for, _of_user, _temporary):
        with suppress(OSError, RuntimeError):  # nowhere to write; no home
            folder = parent() / 'kernels'
            with suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=folder).close()
                return Folders((*filled, folder, IN_PACKAGE), folder)
            if folder.is_dir():
                filled.append(folder)
    return Folders((*filled, IN_PACKAGE), None)


def use_only(folder: Path) -> None:
    """Read and write nothing but this folder from now on."""
    _only.append(folder)
    folders.cache_clear()


def _asked_for() -> Path:
    if not numba.config.CACHE_DIR:
        raise FileNotFoundError('NUMBA_CACHE_DIR')
    return Path(numba.config.CACHE_DIR) / 'dlo_planner'


def _of_user() -> Path:
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'dlo_planner'


def _temporary() -> Path:
    """Return a folder that nobody else can have filled: what lies in it is run."""
    folder = Path(tempfile.gettempdir()) / f'dlo_planner-{os.getuid()}'
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o022:
        raise PermissionError(folder)
    return folder


def prune(folder: Path, room: float = _ROOM) -> None:
    """Delete the files in a folder that have not been used for longest, until the rest has room."""
    files = []
    for path in folder.iterdir():
        with suppress(OSError):  # another process does the same
            status = path.stat()
            files.append((status.st_mtime, status.st_size, path))
    for _, size, path in sorted(files, reverse=True):
        room -= size
        if room < 0:
            path.unlink(missing_ok=True)
