# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 15: a wire is drawn over a bar: on a straight way, and with its direction there kept."""

import numpy as np

from benchmarks.cases import level, wire
from benchmarks.figures._drawing import BY_STEP, held, plt, run, save, scale, side, views
from dlo_planner import Capsule, DirectSimulator, InverseSimulator

PLACE, RADIUS = (0.5, 0.0, 0.7), 0.02
LENGTHS = np.linspace(0.7, 0.3, 9)
WAYS = {'straight': 'straight way, gripper not turned (footnote 19)',
        'aligned': 'direction at the contact kept'}


def bar():
    """Return the bar that is touched."""
    return Capsule((PLACE[0], -0.5, PLACE[2]), (PLACE[0], 0.5, PLACE[2]), RADIUS)


def draw(axis, plan):
    """Draw a plan's shapes, its gripper and the bar."""
    axis.add_patch(plt.Circle((PLACE[0], PLACE[2]), RADIUS, color='0.6'))
    for k, (shape, gripper) in enumerate(zip(plan.shapes, plan.grippers, strict=True)):
        color = BY_STEP(k / len(plan))
        side(axis, shape.positions, color=color, lw=1.0)
        held(axis, gripper, color=color)


def main(folder):
    """Make picture and table."""
    inverse = InverseSimulator(DirectSimulator(wire(1.5e-3), obstacles=[bar()]))
    contact = level(PLACE[2] + RADIUS, PLACE[0])
    figure, both = views(2, 1, size=(8.4, 1.9), sharex=True, sharey=True)
    found = {}
    for axis, (way, title) in zip(both[:, 0], WAYS.items(), strict=True):
        plan = inverse.slide_contact(contact, LENGTHS, mode=way)
        draw(axis, plan)
        axis.set_title(title, fontsize=9)
        turned = [np.degrees(np.arccos(np.clip(
            one.rotation[:, 0] @ plan.grippers[0].rotation[:, 0], -1, 1))) for one in plan.grippers]
        found[way] = {'drift': float(np.degrees(plan.misalignment.max())),
                      'miss': float(plan.position_error.max()), 'turned': float(max(turned))}
    scale(figure, both[:, 0], (0, 1), 'part of the way').set_ticks([0, 1])
    save(figure, folder, 'fig15', 'Fig. 15: length between gripper and contact from 0.7 to '
         '0.3 m, copper wire, d = 1.5 mm, L = 1 m',
         ['way', 'direction there drifts by [deg]', 'place drifts by [m]',
          'gripper turns by [deg]'],
         [[way, f'{row["drift"]:.2g}', f'{row["miss"]:.1e}', f'{row["turned"]:.2f}']
          for way, row in found.items()], found)


if __name__ == '__main__':
    run(main)
