# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Answers of the code as it is are frozen, those that hang on rounding errors left out."""

from benchmarks.oracle import frozen
from benchmarks.oracle.answers import FACTOR, NEAR
from benchmarks.oracle.kinds import KINDS, TOO_LONG, solved

_ROOM = 0.1    # of a tolerance, which rounding errors may take up
_MOST = 1000   # times a tolerance: what is looser is no oracle


def freeze(pool, kinds, shakes, commit, path=frozen.FILE):
    """Freeze the cases of some kinds, one after the other; those of others stay as they are."""
    for kind in kinds:
        known = frozen.load(path) if path.exists() else frozen.Frozen({}, {}, {}, {})
        answers, seconds, left_out = ({key: value for key, value in one.items()
                                       if key[0] in KINDS and key[0] != kind}
                                      for one in known[:3])
        work = [((kind, number), shakes) for number in range(KINDS[kind].count)]
        looser = []
        for (key, _), (answer, spent, why, loose) in zip(work, pool.map(_tried, work),
                                                         strict=True):
            if why:
                left_out[key] = why
            else:
                answers[key], seconds[key] = answer, spent
            looser += [key[1]] * loose
        ordered = [key for name in KINDS for key in sorted(answers) if key[0] == name]
        frozen.save(frozen.Frozen({key: answers[key] for key in ordered}, seconds, left_out,
                                  frozen.versions(commit)), path)
        why = [f'{number} ({text})' for (name, number), text in left_out.items() if name == kind]
        spent = sum(seconds[key] for key in ordered if key[0] == kind)
        print(f'{kind:26s}{sum(key[0] == kind for key in ordered):6d} frozen,'
              f'{len(looser):4d} looser,{len(why):4d} left out, {spent:6.1f} s  '
              + '; '.join(why[:6]), flush=True)
    print(f'{len(answers)} answers, {len(left_out)} left out, {path.stat().st_size} bytes')


def _tried(work):
    """Return Answer, CPU time, why the case is left out or '', and whether it was loosened."""
    key, shakes = work
    if key in TOO_LONG:
        return None, 0.0, 'takes too long', False
    answer, seconds = solved(*key)
    if 'raised' in answer.words:
        raise AssertionError(f'{key}: {answer.words["raised"]}')
    loose = False
    for shake in range(1, shakes + 1):
        other, _ = solved(*key, shake)
        if answer.words != other.words or answer.numbers.keys() != other.numbers.keys():
            name = next((name for name in answer.words | other.words
                         if answer.words.get(name) != other.words.get(name)), 'numbers')
            return answer, seconds, name, False
        for name, field in answer.numbers.items():
            excess = field.excess(other.numbers[name].values)
            if field.how == NEAR and field.tolerance and _ROOM < excess <= _MOST:
                answer.numbers[name] = field._replace(tolerance=field.tolerance * excess / _ROOM)
                loose = True
            elif excess > (0.5 if field.how == FACTOR else 1.0):
                return answer, seconds, name, False
    return answer, seconds, '', loose
