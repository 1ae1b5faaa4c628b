# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A twisted wire that winds itself up, beside the theory of plectonemes.

`python -m benchmarks.strands [ELEMENTS]` (128; half a minute) turns the end of a wire that is held
nearer than it is long, until it throws a loop and winds itself up, and on. Where strands of radius
r wind around each other at an angle a, straight tails beside them, theory says which moment and
pull hold the wire (Clauvelin, Audoly and Neukirch, Macromolecules 41, 2008):
M = 2 EI cos a sin^3 a / (r cos 2a), F = EI sin^4 a (1/2 + 1 / cos 2a) / r^2. What ends the
plectoneme, its loop and its tails, is as it is however long it is, and has no part in that.
"""

import sys
from time import process_time

import numpy as np
from scipy.optimize import brentq

from dlo_planner import DirectSimulator, FarEnd, Pose, Rod

_EI, _LENGTH, _RADIUS = 1.2e-3, 0.6, 4e-3
_ROD = Rod(length=_LENGTH, mass_per_length=0.035, bending_stiffness=_EI,
           torsional_stiffness=0.8 * _EI, radius=_RADIUS)
_GRIPPER = Pose.looking_along((0, 0, 0), (1, 0, 0))
_X = 0.3                  # m, from grip to grip
_TURNS, _STEP = 8.0, 0.125
_LEAST = 12               # places that bear: fewer are no plectoneme


def theory(pull: float) -> tuple[float, float]:
    """Return the angle in rad and the moment in N m of a plectoneme under a pull in N."""
    angle = brentq(lambda a: _EI * np.sin(a)**4 * (0.5 + 1 / np.cos(2 * a)) / _RADIUS**2 - pull,
                   1e-3, 0.25 * np.pi - 1e-6)
    return angle, 2 * _EI * np.cos(angle) * np.sin(angle)**3 / (_RADIUS * np.cos(2 * angle))


def _end(turns):
    a = 2 * np.pi * turns
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    return FarEnd(Pose.from_rotation(np.array([_X, 0, 0]), _GRIPPER.rotation @ about_x))


def angle_of(shape):
    """Return half the angle between two strands in the middle of the places that bear, rad."""
    bears = shape.self_contacts
    one = bears[len(bears) // 2]
    along, back = (shape.frame_at(s)[0][:, 0] for s in (one.s, one.other_s))
    return 0.5 * np.arccos(np.clip(-along @ back, -1.0, 1.0))


def main():
    """Print the table; return 1 where a moment or an angle is off by more than 3 %."""
    elements = int(sys.argv[1]) if len(sys.argv) > 1 else 128
    simulator = DirectSimulator(_ROD, basis='local', n_elements=elements, gravity=(0, 0, 0),
                                self_contact=True)
    print('| turns | pull [N] | moment [N m] | theory | off | angle [rad] | theory | off | places |'
          ' status | CPU [s] |')
    print(f'|{" --- |" * 11}')
    shape, wrong = None, False
    for turns in np.arange(0.0, _TURNS + 1e-9, _STEP):
        began = process_time()
        shape = simulator.solve(_GRIPPER, shape, far_end=_end(turns))
        took, count = process_time() - began, len(shape.self_contacts)
        wrong |= not shape.converged
        if count < _LEAST or turns % 0.5:
            continue
        pull, found = float(shape.far_wrench[0]), abs(shape.far_wrench[3])
        (angle, moment), turned = theory(pull), angle_of(shape)
        off = found / moment - 1, turned / angle - 1
        wrong |= max(map(abs, off)) > 0.03
        print(f'| {turns:g} | {pull:.3f} | {found:.5f} | {moment:.5f} | {off[0]:+.1%} | '
              f'{turned:.4f} | {angle:.4f} | {off[1]:+.1%} | {count} | {shape.status} | '
              f'{took:.2f} |', flush=True)
    return int(wrong)


if __name__ == '__main__':
    sys.exit(main())
