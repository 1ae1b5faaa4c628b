# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A wire is pulled round and let go: what stays, and the moment over curvature of its section.

python examples/plasticity.py [folder]
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

MODELS = {'ideal': 'the paper\'s: all at once', 'rectangular': 'rectangular section',
          'round': 'round section'}


def turned(degrees):
    """Return the gripper turned up by an angle."""
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def circle(curvature):
    """Return the far end of a rod of 1 m bent to a circle."""
    angle = curvature if abs(curvature) > 1e-9 else 1e-9
    return Pose((np.sin(angle) / angle, 0, (1 - np.cos(angle)) / angle),
                Rotation.from_rotvec([0, -angle, 0]).as_quat())


def main():
    """Simulate both and save their picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout='constrained')
    soft = {'yield_stress': 50e6, 'hardening': 0.01}
    wire = Rod.circular(0.5, 1e-3, 8960, 110e9, 0.34, **soft)
    elastic = DirectSimulator(Rod.circular(0.5, 1e-3, 8960, 110e9, 0.34))
    simulator = DirectSimulator(wire)
    shapes = simulator.track([turned(angle) for angle in (-90, -45, 0, -45, -90)])
    for shape, label in zip(shapes, ('hanging', '45 deg', 'level', '45 deg again',
                                     'hanging again'), strict=True):
        left.plot(shape.positions[:, 0], shape.positions[:, 2], label=label)
        print(f'{label:14s} energy lost so far {1e3 * shape.dissipated:.2f} mJ, '
              f'tip {shape.positions[-1].round(3)}')
    reference = elastic.track([turned(angle) for angle in (-90, -45, 0)])[-1].positions
    left.plot(reference[:, 0], reference[:, 2], 'k:', label='level, if elastic')
    left.set_aspect('equal')
    left.set_xlabel('x [m]')
    left.set_ylabel('z [m]')
    left.set_title('Copper wire, yield stress 50 MPa, gripper turned up and down', fontsize=10)
    left.legend(fontsize=8)
    left.grid(alpha=0.3)
    way = np.concatenate([np.linspace(0.05, 3, 30), np.linspace(2.9, -3, 60)])
    for model, label in MODELS.items():
        rod = Rod(1.0, 0.0, 1.0, 0.7, yield_curvature=1.0, section_model=model)
        bent = DirectSimulator(rod, basis='local', n_elements=8, gravity=(0, 0, 0)).track(
            [Pose.identity()] * len(way), far_ends=[circle(k) for k in way])
        right.plot(way, [shape.gripper_wrench[4] for shape in bent], label=label)
    right.set_xlabel('curvature / yield curvature [-]')
    right.set_ylabel('moment / yield moment [-]')
    right.set_title('Bending there and back', fontsize=10)
    right.legend(fontsize=8)
    right.grid(alpha=0.3)
    figure.savefig(folder / 'plasticity.png', dpi=100)


if __name__ == '__main__':
    main()
