# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 1: elastic, then ideally plastic: loading, and a cycle with what remains."""

import numpy as np

from benchmarks.figures._drawing import axes, run, save
from dlo_planner import DirectSimulator, Pose, Rod

_PULLED = 2.5  # yield curvatures, to which it is bent and let go


def circle(curvature):
    """Return the far end of a rod of 1 m bent to a circle."""
    angle = curvature if abs(curvature) > 1e-9 else 1e-9
    return Pose.from_rotation(
        [np.sin(angle) / angle, 0, (1 - np.cos(angle)) / angle],
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])


def moments(way, model):
    """Return the moments at the gripper, in yield moments, of curvatures in yield curvatures.

    Three elements: held as they are, they can bend in one way only. More can share their
    curvature out as they like once the moment is ideally plastic.
    """
    rod = Rod(1.0, 0.0, 1.0, 0.7, yield_curvature=1.0, section_model=model)
    shapes = DirectSimulator(rod, basis='local', n_elements=3, gravity=(0, 0, 0)).track(
        [Pose.identity()] * len(way), far_ends=[circle(k) for k in way])
    assert all(shape.converged for shape in shapes)
    return np.array([shape.gripper_wrench[4] for shape in shapes])


def main(folder):
    """Make picture and table."""
    up = np.linspace(0.05, _PULLED, 50)
    down = np.linspace(_PULLED, _PULLED - 1, 26)[1:]
    figure, (left, right) = axes(2)
    for model, look, label in (('ideal', 'k-', 'elastic, ideally plastic (the paper)'),
                               ('round', 'C0--', 'fibers of a round section')):
        left.plot(np.append(0, up), np.append(0, moments(up, model)), look, label=label)
    there = moments(np.append(up, down), 'ideal')
    kept = float(down[-1] - there[-1])
    for part, text, at in ((slice(0, 20), '1', (0.35, 0.62)), (slice(19, 50), '2', (1.7, 1.07)),
                           (slice(49, 75), '3', (2.13, 0.45))):
        right.plot(np.append(up, down)[part], there[part], lw=2)
        right.annotate(text, at, fontsize=11)
    right.plot([0, up[0]], [0, there[0]], 'C0', lw=2)
    right.annotate(f'$\\epsilon_p$ = {kept:.2f} $\\epsilon_E$', (kept, 0), (kept - 0.95, 0.12),
                   arrowprops={'arrowstyle': '->'})
    for axis in (left, right):
        axis.set_xlabel('curvature $\\kappa/\\kappa_E$ [-]')
        axis.set_ylabel('moment $M/M_E$ [-]')
        axis.set_ylim(-0.05, 1.8 if axis is left else 1.25)
    left.legend(fontsize=8, loc='upper left')
    save(figure, folder, 'fig01', 'Fig. 1: bending in place of strain: loading (left); loading 1, '
         'yielding 2 and relief 3 (right)', ['what', 'found', 'closed form'],
         [['moment when bent to 2.5 yield curvatures, ideal', f'{there[49]:.6f}', '1'],
          ['curvature that remains after relief', f'{kept:.6f}', f'{_PULLED - 1:g}']],
         {'plateau': float(there[49]), 'residual': kept})


if __name__ == '__main__':
    run(main)
