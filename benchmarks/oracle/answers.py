# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is frozen of an answer: numbers with tolerances, words that have to be the same.

A tolerance allows another path of iteration, not another branch, verdict or refusal: a converged
shape may be off by 1e-7 of the length, more where it hardly stands.
"""

import re
from typing import NamedTuple

import numpy as np

from dlo_planner import DloPlannerError, Infeasible

NEAR, FACTOR, BELOW = 'near', 'factor', 'below'  # how two numbers are compared
POSITION = 1e-7      # of the length, of a shape that is converged and stands well
_STANDS = 0.1        # stability; what is less stable may be off by so much more
_MOST = 100.0        # times, at most
_STABILITY = 1e-3, 1e-2  # of an eigenvalue, which is found less exactly; at most
_RESIDUAL = 1e-8     # relative; 1e-7 in contact
_TOUCHES = 1e-5      # of the scale of forces: what presses less touches by chance
_PLACES = np.arange(1, 10) / 9
_EXACT = 1e-10       # of the length: error estimates below are rounding errors
_ROUNDING = 1e-12    # a number in a message that is smaller is what rounding leaves


class Field(NamedTuple):
    """Numbers (n,) of an answer, how they are compared, and the tolerance."""

    values: np.ndarray
    tolerance: float
    how: str = NEAR

    def excess(self, values):
        """Return how far other numbers (n,) are off, in tolerances (1: just within)."""
        if values.shape != self.values.shape:
            return np.inf
        was, now = self.values, values
        same = (was == now) | (np.isnan(was) & np.isnan(now))
        if same.all():
            return 0.0
        was, now = was[~same], now[~same]
        if not (np.isfinite(was).all() and np.isfinite(now).all()):
            return np.inf
        if self.how == FACTOR:  # the tolerance is what counts as zero
            ratio = (np.abs(now) + self.tolerance) / (np.abs(was) + self.tolerance)
            return float(np.abs(np.log2(ratio)).max())
        if self.how == BELOW:  # a rounding error may be ten times another
            return float((now / np.maximum(self.tolerance, 10 * was)).max())
        return float(np.abs(now - was).max() / self.tolerance) if self.tolerance else np.inf


class Scale(NamedTuple):
    """Length (m), energy (J) and force (N) that are typical of a DLO."""

    length: float
    energy: float

    @property
    def force(self):
        """In N."""
        return self.energy / self.length

    @classmethod
    def of(cls, rod):
        """Return the scale of a Rod."""
        s = np.linspace(0, rod.length, 21)
        mass = (rod.masses_per_length(s).mean() * rod.length + rod.tip_mass
                + sum(mass for _, mass in rod.point_masses))
        length = float(rod.length)
        return cls(length, float(rod.stiffness[1:].min()) / length + 9.81 * mass * length)


class Answer:
    """Numbers (name -> Field) and words (name -> str) of one case."""

    def __init__(self, numbers=None, words=None):
        self.numbers = {} if numbers is None else numbers
        self.words = {} if words is None else words

    def put(self, name, values, tolerance, how=NEAR):
        """Add numbers of any shape."""
        values = np.array(values, dtype=float).ravel()
        self.numbers[name] = Field(values, float(tolerance), how)

    def say(self, name, word):
        """Add a word."""
        self.words[name] = str(word)

    def differences(self, other):
        """Return [(name, excess, in words)] of what another answer says differently.

        Words come first: after another verdict, numbers mean nothing.
        """
        names = self.words | other.words
        found = [(name, np.inf, f'{self.words.get(name)} -> {other.words.get(name)}')
                 for name in names if self.words.get(name) != other.words.get(name)]
        if found:
            return found
        for name in self.numbers | other.numbers:
            one, two = self.numbers.get(name), other.numbers.get(name)
            if one is None or two is None:
                found.append((name, np.inf, 'is there' if one is None else 'is missing'))
                continue
            excess = one.excess(two.values)
            if excess > 1.0:
                found.append((name, excess, _in_words(one, two.values)))
        return found


def _in_words(field, values):
    if values.shape != field.values.shape:
        return f'{field.values.size} numbers -> {values.size}'
    with np.errstate(invalid='ignore'):
        off = np.abs(values - field.values)
    k = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
    allowed = 'factor 2' if field.how == FACTOR else f'{field.tolerance:.1g}'
    return f'{field.values[k]:.9g} -> {values[k]:.9g} ({field.how} {allowed})'


def add_shape(answer, shape, rod, loose=1.0, estimate=True):
    """Add what is frozen of a Shape.

    Args:
        loose: by how much more than `POSITION` a position may be off
        estimate: whether its error estimate is read
    """
    answer.say('verdict', ('converged' if shape.converged else 'not converged')
               + (', jumped' if shape.jumped else ''))
    if not shape.converged:
        return
    scale = Scale.of(rod)
    loose *= float(np.clip(_STANDS / max(abs(shape.stability), 1e-12), 1.0, _MOST))
    length, part = scale.length, POSITION * loose
    answer.put('positions', shape.positions_at(_PLACES * shape.s[-1]), part * length)
    answer.put('tip frame', shape.frames[-1][:, :2], 10 * part)
    for name in ('energy', 'elastic_energy'):
        answer.put(name, getattr(shape, name), 3 * part * scale.energy)
    for name in ('gripper_wrench', 'far_wrench'):
        wrench = np.array(getattr(shape, name))
        if name == 'far_wrench' and shape.far_end is None:
            continue
        wrench[3:] /= length
        size = max(scale.force, np.abs(wrench).max())
        answer.put(name, wrench, 3 * part * size)
    if shape.dissipated:
        answer.put('dissipated', shape.dissipated, 10 * part * scale.energy)
    answer.put('stability', shape.stability, min(_STABILITY[0] * loose, _STABILITY[1])
               * max(1.0, abs(shape.stability)))
    residual = _RESIDUAL * (10.0 if shape.contacts else 1.0)
    answer.put('residual', shape.residual, residual, BELOW)
    answer.put('violation', shape.violation, 1e-6 * length, BELOW)
    add_contacts(answer, shape, scale, part)
    if estimate:
        answer.put('error_estimate', shape.error_estimate, _EXACT * length, FACTOR)


def touches(shape, scale):
    """Return what a Shape touches, of some force: obstacle -> forces, their sizes and moment.

    The sums of all contacts with it: whole force (3,) along normals, friction (3,), N, the sum of
    sizes, N, and of sizes times s, N m.
    """
    forces = {}
    for contact in sorted(shape.contacts, key=lambda one: (one.obstacle, one.s)):
        whole = forces.setdefault(contact.obstacle, [np.zeros(3), np.zeros(3), 0.0, 0.0])
        whole[0] += contact.force * contact.normal
        whole[1] += contact.friction
        whole[2] += contact.force
        whole[3] += contact.force * contact.s
    return {k: whole for k, whole in forces.items() if whole[2] > _TOUCHES * scale.force}


def add_contacts(answer, shape, scale, part):
    """Add which obstacles a Shape touches, by which whole forces, and where."""
    touched = touches(shape, scale)
    if touched:
        answer.say('touches', list(touched))
    for k, (normal, friction, force, moment) in touched.items():
        size = max(force, scale.force)
        answer.put(f'force {k}', [*normal, *friction], 10 * part * size)
        answer.put(f'place {k}', moment / force, 300 * part * scale.length * size / force)


def refusal(error):
    """Return the Answer of an error of this package: its kind, and what it names."""
    answer = Answer()
    answer.say('refused', type(error).__name__)
    if isinstance(error, Infeasible):
        answer.say('constraint', error.constraint)
        answer.put('waypoint', error.waypoint, 0.0)
        answer.put('amount', error.amount, 1e-4 * max(abs(error.amount), 1e-3))
        return answer
    head = str(error).split(': ')[0]
    answer.say('names', re.match(r'[\w.\[\]]*', head)[0])
    numbers = re.findall(r'(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?', head)
    known = (float(one) for one in numbers)  # what rounding leaves of a residual is any number
    answer.say('numbers', ' '.join(f'{0.0 if abs(one) < _ROUNDING else one:.6g}' for one in known))
    return answer


def answered(kind, given):
    """Return the Answer of a function of `Given`, of its refusal, or of what it raised else."""
    try:
        return kind(given)
    except DloPlannerError as error:
        return refusal(error)
    except Exception as error:  # a fault: it is told by its kind, like a refusal
        answer = Answer()
        answer.say('raised', f'{type(error).__name__}: {error}')
        return answer
