# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 11: benchmark D: a wire is lowered onto a bar; where each step has to begin."""

import numpy as np

from benchmarks.cases import BAR, level, wire
from benchmarks.figures._drawing import BY_STEP, held, plt, run, save, side, views
from dlo_planner import DirectSimulator

HEIGHTS = np.linspace(0.95, 0.59, 9)
BACK = range(1, 9)


def begun(simulator, followed, back):
    """Return the shapes, each step begun with the right shape of some steps before."""
    return [simulator.solve(shape.gripper, followed[k - back]) if k >= back else shape
            for k, shape in enumerate(followed)]


def wrong(shapes, followed):
    """Return the steps (from 1) whose shape is not the right one, within twice its accuracy."""
    places = np.linspace(0, 1, 101)
    return [k + 1 for k, (one, other) in enumerate(zip(shapes, followed, strict=True))
            if not one.converged or np.linalg.norm(
                one.positions_at(places) - other.positions_at(places), axis=1).max() > 2e-3]


def main(folder):
    """Make picture and table."""
    simulator = DirectSimulator(wire(), obstacles=[BAR])
    followed = simulator.track([level(z) for z in HEIGHTS])
    alone = [simulator.solve(level(z)) for z in HEIGHTS]
    figure, (both,) = views(1, 2, size=(4.0, 4.6), sharex=True, sharey=True)
    for axis, shapes, title in (
            (both[0], alone, 'each step from the undeformed wire\n(dashed: wrong)'),
            (both[1], followed, 'each step from the one before')):
        lost = wrong(shapes, followed)
        axis.add_patch(plt.Circle(BAR.start[[0, 2]], BAR.radius, color='0.6'))
        for k, shape in enumerate(shapes):
            side(axis, shape.positions, color=BY_STEP(k / len(HEIGHTS)),
                 ls='--' if k + 1 in lost else '-')
            axis.text(-0.12, shape.gripper.position[2], str(k + 1), fontsize=8, ha='right',
                      va='center')
            held(axis, shape.gripper, color=BY_STEP(k / len(HEIGHTS)))
        axis.set_xlim(-0.22, 1.02)
        axis.set_title(title, fontsize=9)
    found = {'undeformed': wrong(alone, followed)}
    found |= {str(back): wrong(begun(simulator, followed, back), followed) for back in BACK}
    save(figure, folder, 'fig11', 'Fig. 11: benchmark D: copper wire, d = 1 mm, L = 1 m, lowered '
         'in nine steps of 45 mm onto a bar', ['each step begins with', 'wrong steps'],
         [['the undeformed wire' if name == 'undeformed' else f'the right shape {name} before',
           ', '.join(map(str, steps)) or 'none'] for name, steps in found.items()], found)


if __name__ == '__main__':
    run(main)
