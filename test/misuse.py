# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Every public callable, every argument of it, and what nobody should give for it."""

import importlib
import inspect
import itertools
import pkgutil
import signal
import warnings
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from datetime import datetime
from decimal import Decimal
from enum import Enum
from fractions import Fraction

import numpy as np
from specimens import PUBLIC

import dlo_planner
import msg_helpers
from dlo_planner import DloPlannerError, DoubtfulInput, InvalidRod, InvalidTask, Pose, parallel

SECONDS = 60  # a call that takes longer hangs, however busy the machine is
# not known until they are asked for or looked at, or until there are samples: see their docstrings
MAY_BE_NAN = {'position_error', 'misalignment', 'clearance', 'deviation', 'max_tracking_error',
              'swing', 'arrival',
              'departure', 'dynamic_clearance', 'dynamic_contact_force', 'duration', 'step',
              'workspace_margin', 'mode_margin', 'tolerance', 'success', 'noise', '_estimate',
              'misfit', 'outliers', 'normalized_innovation', 'bend_margin', 'contact_force',
              'dynamic_bend_margin', 'contact_lost', 'largest_friction', 'smooth_bore_force',
              'insertion_force', 'yield_utilization', 'plug_wrenches'}
# what an argument is called in a message where it has another name there
ALSO_CALLED = {'value': 'far_end', 'fraction': 's', 'stamp': 'seconds'}


class _Raises:
    """Whatever is asked of it, it raises."""

    def __iter__(self):
        raise RuntimeError('no items')

    def __array__(self, *_, **__):
        raise RuntimeError('no array')

    def __float__(self):
        raise RuntimeError('no number')

    def __repr__(self):
        raise RuntimeError('no repr')


class _Scalar:
    """An array without axes, as of other libraries."""

    def __array__(self, *_, **__):
        return np.array(1.0)


class _LooksLikeShape:
    """Has some of a Shape's attributes."""

    s, positions, converged = np.linspace(0, 1, 3), np.zeros((3, 3)), True


def _nested(depth):
    inner = []
    for _ in range(depth):
        inner = [inner]
    return inner


def _read_only():
    array = np.arange(3.0)
    array.flags.writeable = False
    return array


# made anew for each call: a generator is empty afterwards
MALFORMED = {
    'None': lambda: None, 'nan': lambda: float('nan'), 'inf': lambda: float('inf'),
    '-inf': lambda: -float('inf'), '-1': lambda: -1, '0': lambda: 0, '-0.0': lambda: -0.0,
    '1e300': lambda: 1e300, '5e-324': lambda: 5e-324, '10**400': lambda: 10**400,
    '2**63': lambda: 2**63, 'True': lambda: True, "''": lambda: '', "'1.0'": lambda: '1.0',
    "'abc'": lambda: 'abc', "b'x'": lambda: b'x', '[]': list, '()': tuple, '{}': dict,
    'set()': set, '[1]': lambda: [1], '[1, 2]': lambda: [1, 2], 'ragged': lambda: [[1, 2], [3]],
    '[nan] * 3': lambda: [float('nan')] * 3, "['a'] * 3": lambda: ['a'] * 3,
    '[None]': lambda: [None], '{1: 2}': lambda: {1: 2}, 'object': object, 'a class': lambda: int,
    'a lambda': lambda: lambda: None, 'generator': lambda: (k for k in range(3)),
    'endless': itertools.count, '[1e70] * 3': lambda: [1e70] * 3, '1e70': lambda: 1e70,
    'objects': lambda: np.array([object()] * 3), 'complex': lambda: np.array([1j] * 3),
    'strings': lambda: np.array(['a'] * 3), 'empty': lambda: np.zeros(0),
    '3 x 3 nan': lambda: np.full((3, 3), np.nan), '2 x 2 x 2': lambda: np.zeros((2, 2, 2)),
    'read-only': _read_only, 'a Pose': Pose.identity, 'a stub': _LooksLikeShape,
    'nested': lambda: _nested(2000), 'long': lambda: [0.0] * 20_000,
    'datetime': lambda: datetime(2026, 1, 1), 'Decimal': lambda: Decimal('1.5'),
    'Fraction': lambda: Fraction(1, 3), 'np.nan': lambda: np.float32('nan'), '1j': lambda: 1j,
    'masked': lambda: np.ma.masked_array([1.0, 2.0, 3.0], [True, False, False]),
    'a duration': lambda: np.timedelta64(1, 's'), 'a date': lambda: np.datetime64('2026-01-01'),
    '3 durations': lambda: [np.timedelta64(1, 's')] * 3, 'bytearray': lambda: bytearray(b'abc'),
    'memoryview': lambda: memoryview(b'abc'), 'a byte': lambda: bytearray(b'a'),
    '4 bytes': lambda: b'abcd', 'rows of bytes': lambda: [bytearray(b'abc')] * 2,
    'a scalar': _Scalar, '3 scalars': lambda: [_Scalar()] * 3,
    'an exception': lambda: ValueError('x'), 'raises': _Raises}


def public_callables():
    """Yield (name, callable, class or None): what users can call; an instance is needed if so."""
    for name, member in PUBLIC.items():
        if not inspect.isclass(member):
            yield name, member, None
        elif not issubclass(member, Exception | Enum):
            yield name, member, None
            yield from _methods(name, member)
    for name in sorted(set(parallel.__all__) - set(PUBLIC)):
        yield f'parallel.{name}', getattr(parallel, name), None
    for module in pkgutil.iter_modules(msg_helpers.__path__):
        inside = importlib.import_module(f'msg_helpers.{module.name}')
        for name, member in vars(inside).items():
            if (inspect.isfunction(member) and member.__module__ == inside.__name__
                    and not name.startswith('_')):
                yield f'{module.name}.{name}', member, None


def _methods(name, kind):
    for attribute, member in inspect.getmembers(kind):
        if attribute.startswith('_'):
            continue
        if inspect.ismethod(member):
            yield f'{name}.{attribute}', member, None
        elif inspect.isfunction(member):
            yield f'{name}.{attribute}', member, kind


def arguments_of(function, kind):
    """Return the dict of inspect.Parameters, those that `**options` stand for among them."""
    parameters = dict(inspect.signature(function).parameters)
    if kind is not None:
        parameters.pop('self')
    for name, stands_for in (('options', dlo_planner.DirectSimulator), ('more', dlo_planner.Rod)):
        if name in parameters:
            del parameters[name]
            for more in inspect.signature(stands_for).parameters.values():
                if more.default is not more.empty and more.name not in parameters:
                    parameters[more.name] = more.replace(kind=more.KEYWORD_ONLY)
    return {name: one for name, one in parameters.items() if not name.startswith('_')}


def outcome(function, keywords, culprit, exempt=()):
    """Return what is wrong with how a call with one malformed argument ends; '' if nothing is.

    Args:
        keywords: of the call
        culprit: name of the malformed one
        exempt: names of attributes of the result that may be nan
    """
    try:
        with _time_limit(), warnings.catch_warnings():
            warnings.simplefilter('error')
            warnings.simplefilter('ignore', DoubtfulInput)  # it is said, and is no fault
            result = function(**keywords)
    except DloPlannerError as error:
        return _misses(str(error), culprit) if isinstance(error, InvalidTask | InvalidRod) else ''
    except _TooLong:
        return f'takes more than {SECONDS} s'
    except Exception as error:  # noqa: BLE001 - that is the question
        return f'raises {type(error).__name__}: {str(error)[:100]}'
    where = _nan_in(result, {*MAY_BE_NAN, *exempt})
    return f'returns nan in {where}' if where else ''


def _misses(message, culprit):
    """Return what a message lacks."""
    names = {culprit.rstrip('s').lower(), ALSO_CALLED.get(culprit, culprit)}
    return '' if any(name in message.lower() for name in names) else f'says only {message[:100]!r}'


def _nan_in(result, exempt, where='result', depth=0):
    if depth > 4:
        return ''
    if isinstance(result, np.ndarray):
        return where if result.dtype.kind == 'f' and np.isnan(result).any() else ''
    if isinstance(result, float):
        return where if np.isnan(result) else ''
    if is_dataclass(result) and not isinstance(result, type):
        parts = {item.name: getattr(result, item.name) for item in fields(result)}
    elif isinstance(result, list | tuple):
        parts = dict(enumerate(result[:100]))
    else:
        return ''
    for name, part in parts.items():
        if name not in exempt:
            found = _nan_in(part, exempt, f'{where}.{name}', depth + 1)
            if found:
                return found
    return ''


class _TooLong(BaseException):
    pass


@contextmanager
def _time_limit():
    def stop(*_):
        raise _TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
