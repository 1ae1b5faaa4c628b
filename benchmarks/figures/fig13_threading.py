# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 13: a wire is threaded through a cut-out, three rigidities; beside it the insertion."""

import numpy as np

from benchmarks.cases import hole, wire
from benchmarks.figures._drawing import BY_STEP, held, run, save, side, views
from dlo_planner import DirectSimulator, InverseSimulator

DIAMETERS = (2.5e-3, 1.6e-3, 1.2e-3)  # m: those of the paper are not known
GOAL = (0.0, 0.0, 1.0)
DEPTHS = np.linspace(0, 0.95, 20)


def draw(left, right, plan, bore):
    """Draw the shapes of a plan, and its gripper's way beside that of an insertion."""
    for k, shape in enumerate(plan.shapes):
        side(left, shape.positions, color=BY_STEP(k / len(plan)), lw=0.9)
    for z in (-1, 1):
        left.plot([0, 0], [1 + 0.02 * z, 1 + 0.15 * z], color='0.4', lw=3)
    side(right, plan.shapes[0].positions, color='k')
    for one, color in ((bore, 'C1'), (plan, 'C0')):
        for gripper in one.grippers:
            held(right, gripper, color=color, lw=1.0, ms=2.5)
    right.plot([], [], color='C0', label='gripper, threading')
    right.plot([], [], color='C1', label='gripper, insertion into a bore')
    right.plot([], [], color='k', label='first shape')


def main(folder):
    """Make picture and table."""
    figure, rows = views(len(DIAMETERS), 2, size=(5.6, 2.2), sharex=True, sharey=True)
    lines, found = [], {}
    for (left, right), diameter in zip(rows, DIAMETERS, strict=True):
        inverse = InverseSimulator(DirectSimulator(wire(diameter)))
        plan = inverse.thread(hole(GOAL), depths=DEPTHS)
        bore = inverse.insert(hole(GOAL), depths=DEPTHS)
        draw(left, right, plan, bore)
        name = f'd = {1e3 * diameter:g} mm'
        right.set_title('the gripper\'s way', fontsize=9)
        left.set_title(f'{name}, EI = {wire(diameter).bending_stiffness[0]:.3g} N m$^2$',
                       fontsize=9)
        way = np.array([pose.position for pose in plan.grippers])
        other = np.array([pose.position for pose in bore.grippers])
        first = plan.shapes[0]
        apart = np.linalg.norm(way - other, axis=1)
        curve = first.positions_at(np.linspace(0, 1, 4001))
        off = max(np.linalg.norm(curve - at, axis=1).min() for at in other)
        found[name] = {'miss': float(plan.position_error.max()), 'first': float(apart[0]),
                       'apart': float(apart.max()), 'curve': float(off)}
        lines.append([name, f'{found[name]["miss"]:.1e}', f'{apart[0]:.1e}', f'{apart.max():.3f}',
                      f'{off:.1e}'])
    rows[0, 1].legend(fontsize=7, loc='lower right')
    save(figure, folder, 'fig13', 'Fig. 13: threading of a copper wire, L = 1 m, through a cut-out '
         'at x = 0, z = 1 m', ['wire', 'largest miss [m]', 'grippers of both tasks at first apart '
                               '[m]', 'later at most [m]', 'insertion off the first shape [m]'],
         lines, found)


if __name__ == '__main__':
    run(main)
