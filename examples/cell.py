# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan for a cell: from where the gripper is, past what stands there, with its tolerance.

python examples/cell.py [folder]
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    Box,
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Uncertainty,
    Workspace,
    replay,
    robustness,
)
from dlo_planner.tasks import concatenate  # noqa: E402

HOSE = Rod.tube(0.8, 0.012, 0.008, 1200.0, 8.0e7, 0.45, natural_curvature=(0.0, 0.4),
                damping=(0.5, 0.02), max_bend_curvature=6.0)
HOLE = CutOut(Pose.looking_along((0.0, 0.0, 1.0), (1, 0, 0)), radius=0.012)
NOW = Pose.looking_along((-0.9, 0.35, 1.15), (1.0, 0.0, 0.1))
SPREAD = Uncertainty(bending_stiffness=0.01, mass=0.005, length=5e-4, natural_curvature=5e-3,
                gripper_position=0.3e-3, gripper_rotation=1e-3)


def main():
    """Plan, prove, and save the picture."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    sheet = Sheet.around(HOLE, 0.5, 0.5, thickness=3e-3)
    post = Box(Pose((-0.25, 0.0, 0.7), (0, 0, 0, 1)), (0.1, 0.4, 0.3))
    cell = Workspace(lower=(-1.5, -0.6, 0.3), upper=(0.3, 0.6, 1.6), keep_out=[post],
                     gripper_radius=0.05)
    direct = DirectSimulator(HOSE, obstacles=[sheet])
    inverse = InverseSimulator(direct, workspace=cell)
    plan = inverse.thread(HOLE, start=NOW, gripper_clearance=0.08)
    way = inverse.approach(HOLE, plan, NOW)
    rim, before, behind = plan.clearances[:, 0].min(axis=0)
    print(f'{len(way)} poses to the hole, {len(plan)} through it; clearance at the rim '
          f'{1e3 * rim:.1f} mm, before the sheet {1e3 * before:.1f} mm, behind it '
          f'{1e3 * behind:.1f} mm; bend margin {plan.bend_margin.min():.1f} 1/m')
    high_post = Box(Pose((-0.25, 0.0, 0.75), (0, 0, 0, 1)), (0.1, 0.4, 0.4))
    try:
        InverseSimulator(direct, workspace=Workspace(keep_out=[high_post], gripper_radius=0.05)
                         ).thread(HOLE, start=NOW)
    except Infeasible as error:
        print(f'with a higher post: {error} ({error.constraint}, {error.amount:.3f} m)')
    report = replay(direct, plan, limits=Limits(), tolerance=3e-3)
    print(f'replayed: miss {report.position_error:.0e} m; in {report.duration:.1f} s '
          f'{1e3 * report.max_tracking_error:.2f} mm, {report.reason or "safe to be executed"}')
    with ProcessPoolExecutor(2) as executor:
        off = robustness(direct, plan, SPREAD, samples=200, executor=executor)
    print(f'under the spreads, {off.worst} hurts most; {100 * off.success:.0f} % of the '
          'samples pass without touching the rim')

    figure = plt.figure(figsize=(13, 5))
    cell_view = figure.add_axes((0.0, 0.02, 0.5, 0.9), projection='3d')
    concatenate(way, plan).plot(ax=cell_view, obstacles=[post])
    cell_view.set_title('past a post, through a hole of 12 mm radius', fontsize=10)
    off.plot(ax=figure.add_axes((0.6, 0.12, 0.38, 0.78)))
    figure.axes[-1].set_title(f'what uncertainty makes of it: {off.success:.0%} get through',
                              fontsize=10)
    figure.savefig(folder / 'cell.png', dpi=100)


if __name__ == '__main__':
    main()
