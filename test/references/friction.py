# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""When does friction give way? Column, ring and capstan by steps of the gripper and by meshes.

python test/references/friction.py [largest step in thousandths of the length] [smallest]

A column and a ring (three quarters of a circle, naturally) are pressed on a floor; the ring is
drawn ahead then. Both stick until the elastica's force leaves the cone: the last step that sticks
and the first that slides have to be on either side of it. A wire that is drawn over a bar slides,
by a force that grows as the elastica and exp(mu phi) say. Printed is what is missed, in %.
"""

import sys
from functools import cache
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parents[2])]

from dlo_planner import Capsule, DirectSimulator, Plane, Pose, Rod  # noqa: E402

STEPS = 0.001, 0.002, 0.005, 0.01, 0.02
MESHES = {'32': {'basis': 'local', 'n_elements': 32}, '64': {'basis': 'local', 'n_elements': 64},
          '128': {'basis': 'local', 'n_elements': 128}, '1e-4': {'accuracy': 1e-4},
          '1e-5': {'accuracy': 1e-5}}
LEVEL = (0.0, 0.0, 0.0, 1.0)
TILT = 1e-3
_G, _BEND = 9.81, 1.5 * np.pi    # 1/m: of the ring
_PRESSED = 0.1


def elastica(s, begin, bend, force):
    """Return x, z, angle downwards and moment at s of a weightless rod (m, m, rad, N m)."""
    def rates(_, y):
        along, up = np.cos(y[2]), np.sin(y[2])
        return [along, -up, bend + y[3], up * force[0] + along * force[1]]

    return solve_ivp(rates, (0, s), begin, rtol=1e-10, atol=1e-12).y[:, -1]


def _leaves_the_cone(mu, miss, guess, step):
    """Return the way at which the force (2nd and 3rd unknown) of a rod that sticks leaves it."""
    def excess(way):
        nonlocal guess
        guess, info, fine, text = fsolve(miss, guess, (way,), full_output=True, xtol=1e-11)
        assert fine == 1 or np.abs(info['fvec']).max() < 1e-9, text
        return abs(guess[1] / guess[2]) - mu

    way = 0.05
    while excess(way) < 0:
        way += step
    return brentq(excess, way - step, way, xtol=1e-7)


@cache
def column_gives_way(mu, side):
    """Return how far a column can be pressed on the floor, bowed to the tilt's side (1) or not."""
    def miss(unknown, pressed):
        moment, *force = unknown
        end = elastica(1.0, [0, 1 - pressed, np.pi / 2 - TILT, moment], 0.0, force)
        return end[0] - np.sin(TILT), end[1], end[3]

    return _leaves_the_cone(mu, miss, [side * 2.0, -side * 2.0, 20.0], 0.01)


@cache
def ring_gives_way(mu):
    """Return how far a pressed ring can be drawn ahead, the contact rolling on the floor."""
    height, half = 2 / _BEND - _PRESSED, np.pi / _BEND

    def miss(unknown, way):
        moment, *force, s = unknown
        end = elastica(s, [way, height, 0, moment], _BEND, force)
        return end[0] + s - half, end[1], end[2] - np.pi, end[3]

    return _leaves_the_cone(mu, miss, [-3.12, 4.92, 18.6, 0.584], 0.005)


def capstan(stiffness, friction, radius, turned):
    """Return the force over the weight that is drawn over a bar, of a DLO that also bends.

    On the bar its moment is EI / R, so no shear is in it, T grows as exp(mu phi). Where it leaves
    the bar, at an angle d to the force in the free span, EI / (2 R^2) = F (1 - cos d): the first
    integral of the elastica, as the span is long. There the reaction is a force at a point, too.
    """
    def leaves(force):
        return np.arccos(1 - stiffness / (2 * radius**2 * force))

    one = leaves(1.0)
    tension = np.cos(one) + friction * np.sin(one)

    def missed(force):
        other = leaves(force)
        inside = tension * np.exp(friction * (turned - one - other))
        return inside - force * (np.cos(other) - friction * np.sin(other))

    return brentq(missed, 1.0, 30.0)


def _outside(expected, before, after):
    """Return by how much, of itself, a way is not within a step."""
    return max(before - expected, expected - after, 0.0) / expected


def _slides(shape, mu):
    return any(np.linalg.norm(contact.friction) >= mu * contact.force * (1 - 1e-6)
               for contact in shape.contacts)


def column(mu, step, how, farthest=0.4):
    """Return by how much a column slips too early or too late, and what is wrong beside.

    It is pressed `farthest` (m) at most; if it still sticks there and may, it is not wrong.
    """
    turn = Rotation.from_euler('y', np.pi / 2 - TILT).as_quat()
    simulator = DirectSimulator(Rod(1.0, 1e-9, 1.0, 0.8), **how,
                                obstacles=[Plane((0, 0, 0), (0, 0, 1), mu)])
    shape = simulator.solve(Pose((0, 0, 1.002), turn))
    for pressed in np.arange(0, farthest, step):
        before, shape = shape, simulator.solve(Pose((0, 0, 1 - pressed), turn), shape)
        if not shape.converged:
            return np.nan, f'not converged at {pressed:.3f}'
        if before.contacts and abs(shape.positions[-1, 0] - before.positions[-1, 0]) > 3e-3:
            wrong = '' if shape.jumped else 'slips in silence'
            side = np.sign(before.contacts[-1].friction[0])  # as it buckles it may take either
            return _outside(column_gives_way(mu, -side), pressed - step, pressed), wrong
    return (0.0, '') if farthest < column_gives_way(mu, 1) else (np.nan, 'sticks')


def ring(mu, step, how):
    """Return the same of a ring that is pressed and drawn ahead."""
    simulator = DirectSimulator(Rod(1.0, 1e-9, 1.0, 0.8, natural_curvature=(_BEND, 0)), **how,
                                obstacles=[Plane((0, 0, 0), (0, 0, 1), mu)])
    shape = simulator.solve(Pose((0, 0, 2 / _BEND + 0.002), LEVEL))
    down = np.append(np.arange(0, _PRESSED - 1e-9, step), _PRESSED)
    for at in [(0, 2 / _BEND - pressed) for pressed in down]:
        shape = simulator.solve(Pose((at[0], 0, at[1]), LEVEL), shape)
        if not shape.converged or _slides(shape, mu):
            return np.nan, f'pressed to {at[1]:.4f}: ' + (
                'slides' if shape.converged else 'not converged')
    for way in np.arange(1, round(0.3 / step) + 1) * step:
        shape = simulator.solve(Pose((way, 0, at[1]), LEVEL), shape)
        if not shape.converged:
            return np.nan, f'not converged at {way:.3f}'
        if _slides(shape, mu) or shape.jumped:
            return _outside(ring_gives_way(mu), way - step, way), (
                'jumped' if shape.jumped else '')
    return np.nan, 'sticks'


def wire_on_a_bar(mu, step, how):
    """Return how far the force that draws a wire over a bar is off, at the worst."""
    radius, thin, stiffness = 0.1, 5e-4, 5e-3
    bar = Capsule((0, -0.3, -radius - thin), (0, 0.3, -radius - thin), radius, mu)
    rod = Rod(1.0, 0.0, stiffness, stiffness, radius=thin, tip_mass=1 / _G)
    simulator = DirectSimulator(rod, **how, obstacles=[bar])
    down = [Pose((-0.3, 0, z), LEVEL) for z in np.append(np.arange(0.14, 0.0, -step), 0.0)]
    aside = [Pose((-0.3 - way, 0, 0), LEVEL) for way in
             np.arange(1, max(round(0.03 / step), 3) + 1) * step]
    shapes = simulator.track(down + aside)
    lost = sum(not shape.converged for shape in shapes)
    worst = 0.0
    for shape in shapes[len(down):]:
        force = shape.gripper_wrench[[0, 2]]
        if shape.converged and -shape.gripper.position[0] - 0.3 >= 0.0099:
            turned = np.pi / 2 + np.arctan2(-force[1], -force[0])
            expected = capstan(stiffness, mu, radius + thin, turned)
            worst = max(worst, abs(np.linalg.norm(force) / expected - 1))
    jumped = sum(shape.jumped for shape in shapes)
    return worst, ', '.join(
        f'{count} {what}' for count, what in ((lost, 'not converged'), (jumped, 'jumped')) if count)


CASES = {'column, mu 0.2': lambda *how: column(0.2, *how),
         'column, mu 0.3': lambda *how: column(0.3, *how),
         'ring, mu 0.45': lambda *how: ring(0.45, *how),
         'ring, mu 0.5': lambda *how: ring(0.5, *how),
         'capstan, mu 0.3': lambda *how: wire_on_a_bar(0.3, *how)}


def main():
    most, least = [*map(int, sys.argv[1:]), 20, 1][:2]
    steps = [step for step in STEPS if least <= 1000 * step <= most]
    worst, wrong = 0.0, []
    for name, case in CASES.items():
        print(f'{name}\nstep   ' + ''.join(f'{mesh:>8}' for mesh in MESHES))
        for step in steps:
            print(f'{step:<7g}', end='')
            for mesh, how in MESHES.items():
                off, text = case(step, how)
                print(f'{100 * off:8.2f}' + '*' * bool(text), end='', flush=True)
                worst = np.fmax(worst, off)
                if text:
                    wrong.append(f'{name}, step {step:g}, mesh {mesh}: {text}')
                    print(wrong[-1], file=sys.stderr, flush=True)
            print()
    print('\n'.join(wrong))
    print(f'off by at most {100 * worst:.2f} %, {len(wrong)} otherwise wrong')


if __name__ == '__main__':
    main()
