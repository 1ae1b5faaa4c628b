# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The file of frozen answers: numbers as float64, the rest as JSON, compressed together."""

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.oracle.answers import Answer, Field

FILE = Path(__file__).with_name('answers.npz')
_BITS = 40  # of the 52 behind the point that are kept, a relative 1e-12: the rest does not compress


class Frozen(NamedTuple):
    """What the file holds.

    Attributes:
        answers: (kind, number) -> Answer
        seconds: (kind, number) -> CPU time in s
        left_out: (kind, number) -> why: cases that are no oracle
        made_by: what made it: commit, versions, machine
    """

    answers: dict
    seconds: dict
    left_out: dict
    made_by: dict


def versions(commit):
    """Return by what answers are made."""
    return {'commit': commit, 'python': platform.python_version(), 'machine': platform.machine(),
            **{name: version(name) for name in ('numpy', 'scipy', 'numba', 'llvmlite')}}


def save(frozen, path=FILE):
    """Write the file."""
    numbers, tolerances, schemas, cases = [], [], {}, []
    for (kind, number), answer in frozen.answers.items():
        schema = json.dumps([[name, field.values.size, field.how]
                             for name, field in answer.numbers.items()])
        numbers += [field.values for field in answer.numbers.values()]
        tolerances += [field.tolerance for field in answer.numbers.values()]
        cases.append([kind, number, schemas.setdefault(schema, len(schemas)),
                      round(frozen.seconds[kind, number], 4), answer.words])
    text = json.dumps({
        'made by': frozen.made_by, 'schemas': [json.loads(one) for one in schemas],
        'cases': cases, 'left out': [[*key, why] for key, why in frozen.left_out.items()]})
    bits = np.concatenate(numbers).view(np.uint64)
    dropped = np.uint64(52 - _BITS)
    half = np.uint64(1) << (dropped - np.uint64(1))
    finite = np.isfinite(bits.view(float))
    bits = np.where(finite, (bits + half) >> dropped << dropped, bits)
    together = bits.view(np.uint8).reshape(-1, 8).T  # bytes of one weight: they compress
    np.savez_compressed(path, text=np.frombuffer(text.encode(), np.uint8), numbers=together,
                        tolerances=np.array(tolerances, np.float32))


def load(path=FILE):
    """Return the Frozen of the file."""
    with np.load(path) as arrays:
        said = json.loads(arrays['text'].tobytes())
        tolerances = iter(arrays['tolerances'].tolist())
        values = np.ascontiguousarray(arrays['numbers'].T).view(float).ravel()
    answers, seconds, begin = {}, {}, 0
    for kind, number, schema, spent, words in said['cases']:
        fields = {}
        for name, size, how in said['schemas'][schema]:
            fields[name] = Field(values[begin:begin + size], next(tolerances), how)
            begin += size
        answers[kind, number], seconds[kind, number] = Answer(fields, words), spent
    return Frozen(answers, seconds, {(kind, number): why for kind, number, why in
                                     said['left out']}, said['made by'])
