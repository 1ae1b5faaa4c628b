# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Benchmark C in motion: the copper wire while its gripper turns by 180 degrees, fast to slow.

python examples/dynamics.py [folder]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from scipy.spatial.transform import Rotation

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402

STEPS, DRAWN = 1200, 24


def gripper(share):
    """Return the gripper of benchmark C at a share of its way, which begins and ends softly."""
    angle = 180 * share**3 * (10 - 15 * share + 6 * share**2)
    return Pose((0, 0, 1), Rotation.from_euler('y', -angle, degrees=True).as_quat())


def main():
    """Simulate turns of three durations and save their picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    wire = Rod.circular(1.0, 1e-3, 8960, 110e9, 0.34, damping=(0.5, 0.01))
    simulator = DirectSimulator(wire)
    grippers = [gripper(share) for share in np.linspace(0, 1, STEPS + 1)]
    figure, axes = plt.subplots(1, 3, figsize=(13, 5), sharex=True, sharey=True,
                                layout='constrained')
    colors = plt.get_cmap('viridis')
    for axis, seconds in zip(axes, (0.4, 1.0, 6.0), strict=True):
        motion = simulator.simulate(grippers, seconds / STEPS)
        for k in range(0, STEPS + 1, STEPS // DRAWN):
            points = motion.shapes[k].positions
            axis.plot(points[:, 0], points[:, 2], color=colors(k / STEPS), lw=1.2)
        force = max(np.linalg.norm(shape.gripper_wrench[:3]) for shape in motion.shapes)
        axis.set_title(f'turned in {seconds:g} s, largest force {force:.2f} N', fontsize=10)
        axis.set_aspect('equal')
        axis.set_xlabel('x [m]')
        axis.grid(alpha=0.3)
        print(f'{seconds:5g} s: converged {motion.converged}, largest force {force:.3f} N')
    axes[0].set_ylabel('z [m]')
    bar = plt.cm.ScalarMappable(plt.Normalize(0, 1), colors)
    figure.colorbar(bar, ax=axes, label='fraction of the turn [-]', shrink=0.8)
    figure.suptitle('Benchmark C with inertia: copper wire, d = 1 mm, L = 1 m')
    figure.savefig(folder / 'dynamics.png', dpi=100)


if __name__ == '__main__':
    main()
