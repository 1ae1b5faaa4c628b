# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames: world, gripper and cut-out, and the arc length of a wire between them.

python examples/frames.py [folder]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod  # noqa: E402

COLORS = {'x': 'tab:red', 'z': 'tab:blue'}


def draw_frame(axes, name, pose, size=0.12):
    """Draw the x and z axes of a pose, from the side."""
    place = pose.position[[0, 2]]
    for axis, column in (('x', 0), ('z', 2)):
        tip = place + size * pose.rotation[[0, 2], column]
        axes.annotate('', tip, place, arrowprops={'arrowstyle': '->', 'lw': 2,
                                                  'color': COLORS[axis]})
        axes.text(*(place + 1.25 * (tip - place)), axis, color=COLORS[axis], ha='center',
                  va='center')
    axes.text(*(place + [0.05, -0.06]), name, ha='left', va='top', fontsize=11)


def main():
    """Thread a wire halfway and draw it from the side."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
    hole = CutOut(Pose((0.9, 0.0, 0.8), (0, 0, 0, 1)), radius=0.01)
    plan = InverseSimulator(DirectSimulator(wire)).thread(hole, depths=np.linspace(0, 0.3, 10))
    shape, gripper = plan.shapes[-1], plan.grippers[-1]
    figure, axes = plt.subplots(figsize=(9, 7), layout='constrained')
    x, _, z = shape.positions.T
    axes.plot(x, z, 'k', lw=2)
    for s in (0.0, 0.25, 0.5, 0.75, 1.0):
        place = [np.interp(s, shape.s, x), np.interp(s, shape.s, z)]
        axes.plot(*place, 'ko', ms=4)
        axes.text(place[0], place[1] - 0.02, f's = {s:g} m', ha='left', va='top', fontsize=8)
    for end in (1, -1):
        axes.plot([0.9, 0.9], [0.8 + end * 0.015, 0.8 + end * 0.2], color='0.5', lw=4)
    draw_frame(axes, 'world', Pose.identity())
    draw_frame(axes, 'gripper: x is the tangent of the DLO', gripper)
    draw_frame(axes, 'cut-out: x is the way through', hole.pose)
    axes.set_aspect('equal')
    axes.set_xlabel('x [m]')
    axes.set_ylabel('z [m]')
    axes.set_xlim(-0.15, 1.4)
    axes.set_ylim(-0.15, 1.1)
    figure.savefig(folder / 'frames.png', dpi=100)
    print(f'gripper at {gripper.position.round(3)}, its x axis {gripper.rotation[:, 0].round(3)}, '
          f'the tangent of the wire there {shape.frames[0, :, 0].round(3)}')


if __name__ == '__main__':
    main()
