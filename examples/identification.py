# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Finding a wire's stiffness and bend from points that a camera saw, and holding it in its middle.

python examples/identification.py [folder]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from scipy.spatial.transform import Rotation

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import DirectSimulator, Pose, Rod, fit_rod
from dlo_planner.identify import Observation
from dlo_planner.rods import GraspedInside


def main():
    """Make observations of a known wire, find it again, and save the picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    true = Rod(1.0, 0.07, 0.02, 0.015, natural_curvature=(0.6, 0.0))
    guess = Rod(1.0, 0.07, 0.05, 0.015)
    poses = [Pose((0, 0, 1), Rotation.from_euler('y', -a, degrees=True).as_quat())
             for a in (0, 60, 120)]
    seen = [Observation(pose, DirectSimulator(true).solve(pose).positions_at(
        np.linspace(0.05, 1, 25)) + 2e-3 * rng.normal(size=(25, 3))) for pose in poses]
    fit = fit_rod(guess, seen, ('bending_stiffness', 'natural_curvature'))
    stiffness, deviation = (found['bending_stiffness'][0]
                            for found in (fit.values, fit.deviations))
    print(f'EI = {stiffness:.5f} +- {deviation:.5f} N m^2 (true 0.02000)')
    bend, deviation = fit.values['natural_curvature'][0], fit.deviations['natural_curvature'][0]
    print(f'natural curvature = {bend:.3f} +- {deviation:.3f} 1/m (true 0.600)')
    print(f'points are {1e3 * fit.misfit:.2f} mm off (noise 2 mm in each direction)')
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout='constrained')
    for k, one in enumerate(seen):
        color = f'C{k}'
        left.plot(one.points[:, 0], one.points[:, 2], '.', color=color, ms=4)
        for rod, style in ((guess, ':'), (fit.rod, '-')):
            points = DirectSimulator(rod).solve(one.gripper).positions
            left.plot(points[:, 0], points[:, 2], style, color=color, lw=1)
    left.set_title('Points seen, first guess (dotted), fit (full)', fontsize=10)
    for at in (0.5, 0.35, 0.2):
        points = GraspedInside(fit.rod, at).solve(poses[0]).positions
        right.plot(points[:, 0], points[:, 2], label=f'held at s = {at:g} m')
    right.set_title('The wire found, held inside', fontsize=10)
    right.legend(fontsize=8)
    for axis in (left, right):
        axis.set_aspect('equal', adjustable='datalim')
        axis.set_xlabel('x [m]')
        axis.set_ylabel('z [m]')
        axis.grid(alpha=0.3)
    figure.savefig(folder / 'identification.png', dpi=100)


if __name__ == '__main__':
    main()
