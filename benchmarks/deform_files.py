# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The files of the DEFORM data set: numbers only, and what cannot be a cable is refused.

The layout, as the public code of roahmlab/DEFORM reads it (`train_DEFORM.py`): files
`data_set/DLOk/train/*.pkl` and `data_set/DLOk/eval/*.pkl`; each is a sequence over time (100 Hz) of
x, y, z (3 rows, m, z up) of n markers, 13 on cable 1, 12 on the others. The first two and the last
two markers sit on the grippers; between the second and the last but one the cable is free.
"""

import pickle
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from benchmarks.deform_data import Array, Recording

_LENGTHS = 0.05, 20.0     # m: of cables; what is longer is not in meters
_ASIDE = 2.0              # times farther aside than down: z is not up
_UNREADABLE = ValueError, TypeError, EOFError, IndexError, AttributeError, pickle.UnpicklingError
_ALLOWED = {('builtins', name) for name in ('list', 'tuple', 'float', 'int')} | {
    (f'numpy.{core}.{module}', name) for core in ('core', '_core')
    for module, name in (('multiarray', '_reconstruct'), ('multiarray', 'scalar'),
                         ('numeric', '_frombuffer'))} | {('numpy', 'ndarray'), ('numpy', 'dtype')}


class _NumbersOnly(pickle.Unpickler):
    """Reads arrays, lists and numbers; a pickle can ask for any code, which is refused."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ('_codecs', 'encode'):
            return _encoded
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f'expected numbers only, found {module}.{name}')
        return super().find_class(module, name)


def _encoded(text: str, encoding: str) -> bytes:
    """Return the bytes of an array as files of protocol 2 write them."""
    if encoding != 'latin1':
        raise pickle.UnpicklingError(f'expected bytes as latin1, found {encoding}')
    return text.encode(encoding)


def load(file: BinaryIO) -> Array:
    """Return the markers (frames, markers, 3) in m of a recording.

    Raises:
        ValueError: the file holds anything else, or it cannot be a cable in meters
        pickle.UnpicklingError: it asks for more than numbers
    """
    found = np.array(_NumbersOnly(file, encoding='latin1').load(), dtype=float)
    if found.ndim != 3 or found.shape[1] != 3 or found.shape[0] < 3 or found.shape[2] < 6:
        raise ValueError(f'a recording has shape {found.shape}: expected (frames, 3, markers), at '
                         'least 3 frames and 6 markers')
    found = np.ascontiguousarray(found.swapaxes(1, 2))
    missing = np.argwhere(~np.isfinite(found).all(axis=2))
    if len(missing):
        raise ValueError(f'{len(missing)} places of markers are not finite, the first is marker '
                         f'{missing[0, 1]} in frame {missing[0, 0]}')
    _judge_scale(found)
    return found


def _judge_scale(found: Array) -> None:
    """Raise ValueError where markers (frames, markers, 3) cannot be those of a cable in meters."""
    apart = np.linalg.norm(np.diff(found, axis=1), axis=2)
    if not apart.all():
        frame, marker = np.argwhere(apart == 0)[0]
        raise ValueError(f'markers {marker} and {marker + 1} are at one place in frame {frame}')
    length = np.median(apart.sum(axis=1))
    if not _LENGTHS[0] <= length <= _LENGTHS[1]:
        raise ValueError(f'from the first marker to the last one the cable is {length:.3g} long: '
                         f'expected meters, {_LENGTHS[0]:g} to {_LENGTHS[1]:g}')


def recordings(root: Path, cable: int, part: str, least: int = 4) -> list[Recording]:
    """Return the Recordings of a cable (1 to 5), of `least` frames or more, as many markers each.

    Args:
        root: of the clone
        part: 'train' or 'eval'

    Raises:
        FileNotFoundError: there are none
        ValueError: a file is not a recording of a cable that hangs; the message names it
    """
    folder = root / 'data_set' / f'DLO{cable}' / part
    paths = sorted(folder.glob('*.pkl'), key=lambda path: (len(path.stem), path.stem))
    if not paths:
        raise FileNotFoundError(f'{folder}: expected recordings, files *.pkl')
    out = []
    for path in paths:
        try:
            with path.open('rb') as file:
                markers = load(file)
            if len(markers) < least:
                raise ValueError(f'{len(markers)} frames: expected {least} or more')
            if out and markers.shape[1] != out[0].markers.shape[1]:
                raise ValueError(f'{markers.shape[1]} markers: expected '
                                 f'{out[0].markers.shape[1]}, as in {out[0].name}.pkl')
        except _UNREADABLE as error:
            raise ValueError(f'{path}: {error}') from error
        out.append(Recording(path.stem, markers))
    _judge_up(folder, out)
    return out


def _judge_up(folder: Path, found: list[Recording]) -> None:
    """Raise ValueError where cables do not hang down, but far more to another side."""
    sag = np.mean([one.sag for one in found], axis=0)
    if _ASIDE * -sag[2] < np.abs(sag).max():
        side = int(np.argmax(np.abs(sag)))
        raise ValueError(f'{folder}: on average cables hang by {abs(sag[side]):.2g} m along '
                         f'{"-+"[int(sag[side] > 0)]}{"xyz"[side]}: expected z up')
