# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A twisted wire that winds itself up, beside the theory of plectonemes.

`python -m benchmarks.strands [ELEMENTS]` (128; half a minute) turns the end of a wire that is held
nearer than it is long, until it throws a loop and winds itself up, and on. Where strands of radius
r wind around each other at an angle a, straight tails beside them, theory says which moment and
pull hold the wire (Clauvelin, Audoly and Neukirch, Macromolecules 41, 2008):
M = 2 EI cos a sin^3 a / (r cos 2a), F = EI sin^4 a (1/2 + 1 / cos 2a) / r^2. What ends the
plectoneme, its loop and its tails, is as it is however long it is, and has no part in that.

`python -m benchmarks.strands motions [COUNT]` (100) turns a wire at random, and then leads and
tilts its end on a random closed way within 0.6 s: twist and writhe together are to be what they
were. `python -m benchmarks.strands walks [COUNT]` (20) does so at rest, and turns it on.
"""

import sys
from time import process_time

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, FarEnd, Pose, Rod
from dlo_planner.direct.shape import kernel_arrays
from dlo_planner.geometry.writhe import link

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


_THICK = Rod(length=_LENGTH, mass_per_length=0.035, bending_stiffness=_EI,
             torsional_stiffness=0.8 * _EI, radius=6e-3, damping=(0.0, 2e-3))
_INSTANTS, _DT = 61, 0.01  # of a motion, s


def _pose(place, turn, turns):
    about_x = Rotation.from_rotvec([2 * np.pi * turns, 0, 0]).as_matrix()
    return Pose.from_rotation(place, turn @ _GRIPPER.rotation @ about_x)


def _link(shape):
    return float(link(*kernel_arrays(shape), 0.0))


def motions(count: int) -> int:
    """Print a row for each random motion; return 1 where one is not complete or loses link."""
    simulator = DirectSimulator(_THICK, basis='local', n_elements=48, self_contact=True)
    print('| motion | status | places that touch, most | change of link | lost by integrator [J] |'
          ' moved [J] | CPU [s] |', f'|{" --- |" * 7}', sep='\n')
    wrong = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        turns, begin = rng.uniform(1.5, 3.0) * rng.choice([-1, 1]), [rng.uniform(0.25, 0.45), 0, 0]
        ways, tilt = rng.normal(scale=0.06, size=(2, 3)), rng.normal(scale=0.4, size=3)
        ends = [FarEnd(_pose(begin + w * (ways[0] + ways[1] * np.sin(2 * np.pi * t)),
                             Rotation.from_rotvec(w * tilt).as_matrix(), turns))
                for t in np.linspace(0, 1, _INSTANTS) for w in [np.sin(np.pi * t) ** 2]]
        start = simulator.track([_GRIPPER] * 13, far_ends=[
            FarEnd(_pose(begin, np.eye(3), part * turns)) for part in np.linspace(0, 1, 13)])[-1]
        began = process_time()
        motion = simulator.simulate([_GRIPPER] * _INSTANTS, _DT, initial=start, far_ends=ends)
        took, change = process_time() - began, _link(motion.shapes[-1]) - _link(start)
        wrong += motion.status != 'complete' or abs(change) > 1e-6
        print(f'| {seed} | {motion.status} | {max(len(s.self_contacts) for s in motion.shapes)} | '
              f'{change:.1e} | {motion.numerical_loss[-1]:.1e} | {motion.kinetic_energy.max():.1e}'
              f' | {took:.1f} |', flush=True)
    print(f'{count - wrong} of {count} are complete and keep their link to 1e-6')
    return int(wrong > 0)


def walks(count: int) -> int:
    """Print a row for each random walk; return 1 where a step is not found or loses two turns."""
    wrong = 0
    print('| walk | falls | places that touch at its end | largest change of link in a step |'
          ' CPU [s] |', f'|{" --- |" * 5}', sep='\n')
    for seed in range(count):
        rng, place, turn = np.random.default_rng(seed), np.array([0.4, 0, 0]), Rotation.identity()
        place[0] += 0.1 * rng.random()
        twist, ends = Rotation.from_rotvec([0.6 * rng.choice([-1, 1]), 0, 0]), []
        for k in range(36):
            turn = twist * turn if k else turn
            if k > 3:
                place = place + rng.normal(scale=0.02, size=3)
                turn = Rotation.from_rotvec(rng.normal(scale=0.12, size=3)) * turn
                place = place * min(1.0, 0.5 / np.linalg.norm(place))
            ends.append(FarEnd(_pose(place, turn.as_matrix(), 0.0)))
        simulator = DirectSimulator(_THICK, basis='local', n_elements=48, self_contact=True,
                                    gravity=(0, 0, 0 if seed % 2 else -9.81))
        began = process_time()
        shapes = simulator.track([_GRIPPER] * 36, far_ends=ends)
        change = np.abs(np.diff([_link(shape) for shape in shapes])).max()
        wrong += change > 1.0 or not all(shape.converged and shape.passed_itself is False
                                         for shape in shapes)
        print(f'| {seed} | {sum(shape.jumped for shape in shapes)} | '
              f'{len(shapes[-1].self_contacts)} | {change:.2f} | {process_time() - began:.1f} |',
              flush=True)
    print(f'{count - wrong} of {count} keep their link, all 36 steps found')
    return int(wrong > 0)


def main():
    """Print the table; return 1 where a moment or an angle is off by more than 3 %."""
    for name, table, most in (('motions', motions, 100), ('walks', walks, 20)):
        if name in sys.argv[1:2]:
            return table(int(sys.argv[2]) if len(sys.argv) > 2 else most)
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
