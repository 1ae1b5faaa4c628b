# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Inverse tasks beside threading: two cut-outs (Fig. 14), a contact held and slid (Fig. 15, 16).

python examples/inverse_tasks.py [folder]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    Capsule,
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    replay,
)


def draw(axis, plan, every):
    """Draw some of a plan's shapes and the gripper's way."""
    for k in range(0, len(plan), every):
        points = plan.shapes[k].positions
        axis.plot(points[:, 0], points[:, 2], color=plt.get_cmap('viridis')(k / len(plan)), lw=1)
    way = np.array([gripper.position for gripper in plan.grippers])
    axis.plot(way[:, 0], way[:, 2], 'k.-', ms=3, lw=0.8, label='gripper')
    axis.set_aspect('equal')
    axis.set_xlabel('x [m]')
    axis.set_ylabel('z [m]')
    axis.grid(alpha=0.3)


def main():
    """Plan all three and save their picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34, damping=(0.5, 0.01))
    free = DirectSimulator(wire)
    first, second = (CutOut(Pose.looking_along(p, (1, 0, 0))) for p in ((0, 0, 1), (0.3, 0, 0.97)))
    two = InverseSimulator(free).thread_two(first, second)
    report = replay(free, two, limits=Limits(), tolerance=2e-3)
    print(f'two cut-outs: {len(two)} poses, replayed miss {report.position_error:.1e} m; in '
          f'{report.duration:.1f} s {1e3 * report.max_tracking_error:.2f} mm, '
          f'{report.reason or "safe to be executed"}')
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
    touching = InverseSimulator(DirectSimulator(wire, basis='local', obstacles=[bar]))
    top = Pose((0.5, 0, 0.72), (0, 0, 0, 1))
    held = touching.hold_contact(top, 0.6, condition=None)
    forces = [shape.contacts[0].force for shape in held.shapes]
    print(f'contact held: {len(held)} of the possible gripper poses, force {forces[0]:.3f} to '
          f'{forces[-1]:.3f} N, stability {held.stability.min():.2f} at least')
    slid = touching.slide_contact(top, np.linspace(0.7, 0.3, 9))
    print(f'contact slid: {len(slid)} poses, largest miss {slid.position_error.max():.1e} m')
    figure, axes = plt.subplots(3, 1, figsize=(8, 10), layout='constrained')
    for axis, plan, every, title in (
            (axes[0], two, 3, 'Through two cut-outs'),
            (axes[1], held, 2, 'Contact held: every one of these is a solution'),
            (axes[2], slid, 1, 'Contact slid, direction there kept')):
        draw(axis, plan, every)
        axis.set_title(title, fontsize=10)
    for cutout in (first, second):
        x, z = cutout.center[[0, 2]]
        for side in (-1, 1):
            axes[0].plot([x, x], [z + side * 0.02, z + side * 0.12], color='0.4', lw=3)
    for axis in axes[1:]:
        axis.add_patch(plt.Circle((0.5, 0.7), 0.02, color='0.6'))
    axes[0].legend(fontsize=8)
    figure.suptitle('Copper wire, d = 1.5 mm, L = 1 m')
    figure.savefig(folder / 'inverse_tasks.png', dpi=100)


if __name__ == '__main__':
    main()
