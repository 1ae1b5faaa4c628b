# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Both ends held: a hose between two connectors, and a ring that is twisted until it gives way.

python examples/both_ends.py [folder]
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


def main():
    """Simulate both and save their picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    figure = plt.figure(figsize=(12, 5), layout='constrained')
    left = figure.add_subplot(121, projection='3d')
    right = figure.add_subplot(122)
    hose = Rod.tube(1.0, 20e-3, 14e-3, 1200, 8e6, 0.45)
    start = Pose((0, 0, 0.5), (0, 0, 0, 1))
    ends = [Pose((x, y, 0.5), Rotation.from_rotvec([0, 0, turn]).as_quat())
            for x, y, turn in zip(np.linspace(0.9, 0.3, 7), np.linspace(0, 0.5, 7),
                                  np.linspace(0, np.pi, 7), strict=True)]
    for k, shape in enumerate(DirectSimulator(hose).track([start] * 7, far_ends=ends)):
        left.plot(*shape.positions.T, color=plt.get_cmap('viridis')(k / 7), lw=2)
        print(f'hose, far end {k}: force there {np.linalg.norm(shape.far_wrench[:3]):.2f} N, '
              f'converged {shape.converged}')
    sizes = [np.ptp(ends) for ends in (left.get_xlim(), left.get_ylim(), left.get_zlim())]
    left.set_box_aspect(sizes, zoom=0.85)  # equal axes, with room for their labels
    left.set_xlabel('x [m]', labelpad=8)
    left.set_ylabel('y [m]', labelpad=8)
    left.set_zlabel('z [m]')
    left.set_title('Hose, 20 mm, L = 1 m: far end brought round', fontsize=10)
    ring_rod = Rod(1.0, 0.0, 1.0, 0.7)
    simulator = DirectSimulator(ring_rod, basis='local', gravity=(0, 0, 0))
    origin = Pose.identity()
    closing = [Pose((np.sin(a) / a, 0, (1 - np.cos(a)) / a),
                    Rotation.from_rotvec([0, -a, 0]).as_quat())
               for a in np.linspace(0.1, 2 * np.pi, 30)]
    ring = simulator.track([origin] * 30, far_ends=closing)[-1]
    critical = 2 * np.pi * np.sqrt(3) / 0.7
    twists = np.linspace(0, 1.15, 47) * critical
    shapes = simulator.track([origin] * len(twists), initial=ring, far_ends=[
        Pose((0, 0, 0), Rotation.from_rotvec([a, 0, 0]).as_quat()) for a in twists])
    right.plot(twists / critical, [shape.energy for shape in shapes], '.-')
    right.axvline(1, color='k', ls=':', label='Michell: 2 pi sqrt(3) EI / GJ')
    fallen = next(k for k, shape in enumerate(shapes) if shape.jumped)
    print(f'the ring gives way between {twists[fallen - 1] / critical:.3f} and '
          f'{twists[fallen] / critical:.3f} of Michell\'s twist')
    right.set_xlabel('twist / critical twist [-]')
    right.set_ylabel('energy [EI / L]')
    right.set_title('Ring of a straight rod, twisted', fontsize=10)
    right.legend(fontsize=8)
    right.grid(alpha=0.3)
    figure.savefig(folder / 'both_ends.png', dpi=100)


if __name__ == '__main__':
    main()
