# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Record looks.csv: what a camera sees of a hose that is not as its data sheet says.

python examples/ros/tracker/record.py; the hose is one of a physics engine (extra `cell`).
"""

import csv
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[2]))
from dlo_planner import CutOut, Pose  # noqa: E402
from dlo_planner.cell.camera import Camera, Viewer  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402
from dlo_planner.cell.truth import Truth  # noqa: E402
from dlo_planner.settings.build import rod_of  # noqa: E402
from dlo_planner.settings.yaml_files import read_values  # noqa: E402

GRIPPER = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
TRUTH = Truth(bending_stiffness=1.25, natural_curvature=((0.0,), (0.3,)))
CAMERA = Camera(rate=5.0, latency=0.0, points=40, outliers=0.05)
LOOKS = 20


def main():
    """Let the hose hang before the camera, and write what it sees."""
    rod = rod_of(read_values(str(HERE / 'planner.yaml'))[0])
    plant = Plant(rod, GRIPPER, [], truth=TRUTH)
    viewer = Viewer(CAMERA, np.random.default_rng(1))
    with (HERE / 'looks.csv').open('w', newline='') as file:
        rows = csv.writer(file, lineterminator='\n')
        rows.writerow(['look', 'x', 'y', 'z'])
        for look in range(LOOKS):
            while not (images := viewer.images(plant, CutOut(GRIPPER))):
                plant.move(GRIPPER, 0.02)
            rows.writerows([look, *(f'{one:.5f}' for one in point)] for point in images[0].points)
    print(f'{LOOKS} looks; the free end is at {plant.points([plant.length])[0].round(4)} m')


if __name__ == '__main__':
    main()
