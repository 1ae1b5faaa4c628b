# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Benchmark D (Fig. 11): a wire is lowered onto a bar, step by step and each step by itself.

python examples/obstacles.py [folder]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import Capsule, DirectSimulator, Pose, Rod  # noqa: E402

BAR = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)


def main():
    """Simulate both and save their picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    wire = Rod.circular(1.0, 1e-3, 8960, 110e9, 0.34)
    simulator = DirectSimulator(wire, obstacles=[BAR])
    grippers = [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(0.95, 0.59, 9)]
    alone = [simulator.solve(gripper) for gripper in grippers]
    followed = simulator.track(grippers)
    figure, axes = plt.subplots(1, 2, figsize=(11, 6), sharex=True, sharey=True,
                                layout='constrained')
    colors = plt.get_cmap('viridis')
    for axis, shapes, title in ((axes[0], alone, 'each step from the undeformed wire: it "jumps"'),
                                (axes[1], followed, 'each step from the one before')):
        axis.add_patch(plt.Circle((0.3, 0.7), 0.02, color='0.6'))
        for k, shape in enumerate(shapes):
            axis.plot(shape.positions[:, 0], shape.positions[:, 2], color=colors(k / 9), lw=1.2)
            for contact in shape.contacts:
                tip = contact.position + contact.vector
                axis.annotate('', tip[[0, 2]], contact.position[[0, 2]],
                              arrowprops={'arrowstyle': '->', 'color': 'tab:red'})
        axis.set_title(title, fontsize=10)
        axis.set_aspect('equal')
        axis.set_xlabel('x [m]')
        axis.grid(alpha=0.3)
    axes[0].set_ylabel('z [m]')
    figure.suptitle('Benchmark D: copper wire, d = 1 mm, L = 1 m, on a bar; red: contact forces, '
                    '1 N per m')
    figure.savefig(folder / 'obstacles.png', dpi=100)
    for k, (one, other) in enumerate(zip(alone, followed, strict=True)):
        force = sum(contact.force for contact in other.contacts)
        below = one.positions[-1, 2] < other.positions[-1, 2] - 0.1
        print(f'step {k + 1}: contact force {force:.4f} N, stability {other.stability:.2f}'
              + (', alone it is below the bar' if below else ''))


if __name__ == '__main__':
    main()
