# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 2: the trihedron turns with the curvature, about an axis at an angle q_d to n."""

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.figures._drawing import plt, run, save
from dlo_planner import DirectSimulator, Pose, Rod

_DIRECTION, _AMOUNT, _LENGTH = np.radians(35.0), 1.1, 1.0  # q_d, q_kappa in 1/m, m
_NAMES = ('t', 'n', 'b')


def bent():
    """Return the Shape of a weightless DLO with constant curvature in that direction."""
    curvature = _AMOUNT * np.array([np.cos(_DIRECTION), np.sin(_DIRECTION)])
    rod = Rod(_LENGTH, 0.0, 1.0, 1.0, natural_curvature=tuple(curvature))
    return DirectSimulator(rod, gravity=(0, 0, 0)).solve(Pose.identity())


def draw(axis, place, frame, primes=''):
    """Draw a trihedron."""
    for column, name, color in zip(frame.T, _NAMES, ('C3', 'C2', 'C0'), strict=True):
        axis.quiver(*place, *(0.45 * column), color=color, lw=1.6, arrow_length_ratio=0.15)
        axis.text(*(place + 0.52 * column), f'{name}{primes}', color=color, fontsize=11)


def main(folder):
    """Make picture and table."""
    shape = bent()
    figure, both = plt.subplots(1, 2, figsize=(10.0, 4.8), layout='constrained',
                                subplot_kw={'projection': '3d'})
    first, last = shape.frames[0], shape.frames[-1]
    turn = np.cos(_DIRECTION) * first[:, 1] + np.sin(_DIRECTION) * first[:, 2]
    printed = Rotation.from_rotvec(turn * _AMOUNT * _LENGTH).as_matrix() @ first
    off = float(np.abs(printed - last).max())
    for axis, title in zip(both, ('before: axis of rotation, $q_d$ from n', 'after: turned by '
                                  '$dw_\\kappa = q_\\kappa\\,ds$'), strict=True):
        axis.plot(*shape.positions.T, color='0.3', lw=3, alpha=0.8)
        draw(axis, shape.positions[0], first)
        axis.plot(*np.array([-0.3 * turn, 0.6 * turn]).T, 'k--', lw=1.2)
        axis.set_title(title, fontsize=10)
        axis.set(xlabel='x [m]', ylabel='y [m]', zlabel='z [m]', xlim=(-0.1, 1.3), ylim=(-0.5, 0.9),
                 zlim=(-0.8, 0.6))
        axis.set_box_aspect((1, 1, 1), zoom=0.93)
        axis.view_init(25, -48)
    arc = np.linspace(0, _DIRECTION, 20)[:, None]
    both[0].plot(*(0.3 * (np.cos(arc) * first[:, 1] + np.sin(arc) * first[:, 2])).T, 'k', lw=1)
    middle = 0.36 * (np.cos(0.5 * _DIRECTION) * first[:, 1]
                     + np.sin(0.5 * _DIRECTION) * first[:, 2])
    both[0].text(*middle, '$q_d$')
    draw(both[1], shape.positions[-1], last, '\'')
    save(figure, folder, 'fig02', 'Fig. 2: curvature as direction $q_d$ and amount $q_\\kappa$',
         ['what', 'found'], [['largest difference of the last trihedron and the rotation by '
                              'q_kappa L about the axis of the paper', f'{off:.1e}']], {'off': off})


if __name__ == '__main__':
    run(main)
