# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 7: benchmark C: the gripper turns by 180 degrees in steps of 10 degrees, and back."""

from benchmarks.cases import ANGLES, turned, wire
from benchmarks.figures._drawing import BY_STEP, held, run, save, scale, side, views
from dlo_planner import DirectSimulator


def main(folder):
    """Make picture and table."""
    shapes = DirectSimulator(wire()).track([turned(angle) for angle in ANGLES])
    figure, (both,) = views(1, 2, size=(5.6, 3.8), sharex=True, sharey=True)
    for axis, part, title in ((both[0], slice(0, 19), 'there: 0 to 180 degrees'),
                              (both[1], slice(18, 37), 'back: 180 to 0 degrees')):
        for shape, angle in zip(shapes[part], ANGLES[part], strict=True):
            side(axis, shape.positions, color=BY_STEP(angle / 180),
                 ls='--' if shape.jumped else '-', lw=2 if shape.jumped else 1.2)
            held(axis, shape.gripper, color=BY_STEP(angle / 180))
        axis.set_title(title + ' (dashed: it has fallen over)', fontsize=9)
    scale(figure, both, (0, 180), 'gripper above the level [degrees]').set_ticks(range(0, 181, 30))
    jumped = [ANGLES[k] for k, shape in enumerate(shapes) if shape.jumped]
    save(figure, folder, 'fig07', 'Fig. 7: benchmark C: copper wire, d = 1 mm, L = 1 m',
         ['what', 'found'],
         [['poses that converged', f'{sum(shape.converged for shape in shapes)} of {len(shapes)}'],
          ['falls over on the way to (degrees)', ', '.join(map(str, jumped))],
          ['tip at 80 degrees, there and back: z [m]',
           f'{shapes[8].positions[-1, 2]:.4f}, {shapes[28].positions[-1, 2]:.4f}']],
         {'jumped': jumped})


if __name__ == '__main__':
    run(main)
