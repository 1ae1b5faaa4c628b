# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Files at the door: what is no file, is too large or of another encoding is refused by name."""

import os
import stat
from os import PathLike
from pathlib import Path

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, shown

_MOST = 2**30  # bytes
_MOST_OF_TEXT = 2**22  # bytes that are read as YAML or CSV: half a minute
_UTF_16 = (b'\xff\xfe', b'\xfe\xff')
_ELSE = ((stat.S_ISDIR, 'a folder'), (stat.S_ISFIFO, 'a pipe'), (stat.S_ISSOCK, 'a socket'),
         (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'))


def readable(path: str | PathLike[str], most: int = _MOST) -> Path:
    """Return the path of a file that can be read without waiting for anybody.

    Parameters
    ----------
    path : str or PathLike
    most : int, optional
        Its largest size in bytes.

    Raises
    ------
    InvalidTask
        It is not there, is no file, or is larger.
    """
    size = _size(path)
    if size is None:
        raise InvalidTask(f'{_named(path)}: expected a file, there is none')
    if size > most:
        raise InvalidTask(f'{_named(path)}: expected a file of at most {most} bytes, it has {size}')
    return Path(path)


def writable(path: str | PathLike[str]) -> Path:
    """Return the path of a file that can be written, or written anew; raise as `readable`."""
    if not os.path.basename(instance('path', path, (str, PathLike))):  # '' would mean '.'
        raise InvalidTask(f'{_named(path)}: expected the name of a file')
    _size(path)
    folder = Path(path).parent
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InvalidTask(f'{_named(path)}: expected a folder that can be written to, not '
                          f'{shown(str(folder))}')
    return Path(path)


def text_of(path: str | PathLike[str], most: int = _MOST_OF_TEXT) -> str:
    """Return the UTF-8 text of a file; raise as `readable` does, and of another encoding."""
    try:
        content = readable(path, most).read_bytes()
    except OSError as error:
        raise InvalidTask(f'{_named(path)}: expected a file to read, {error}') from None
    try:
        return content.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = content.count(b'\n', 0, error.start) + 1
        other = 'UTF-16' if content[:2] in _UTF_16 else 'Latin-1 or another encoding'
        raise InvalidTask(f'{_named(path)}, line {line}: expected UTF-8, it is {other} (byte '
                          f'0x{content[error.start]:02x})') from None


def _named(path: str | PathLike[str]) -> str:
    return f'path = {shown(str(path))}'


def _size(path: str | PathLike[str]) -> int | None:
    """Return the size of a file in bytes, None if nothing is there; refuse what is no file."""
    instance('path', path, (str, PathLike))
    try:
        found = Path(path).stat()
    except FileNotFoundError:
        return None
    except (OSError, TypeError, ValueError) as error:  # TypeError: of bytes
        raise InvalidTask(f'{_named(path)}: expected a file, {error}') from None
    other = next((what for is_one, what in _ELSE if is_one(found.st_mode)), '')
    if other:
        raise InvalidTask(f'{_named(path)}: expected a file, it is {other}')
    return found.st_size
