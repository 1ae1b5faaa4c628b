# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where to hold a wire that is threaded in a small cell, and how to hold a plug: maps over grasps.

python examples/which_grasp.py [folder]
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Pose,
    Rod,
    Thread,
    Workspace,
)
from dlo_planner.parallel import which_grasp  # noqa: E402
from dlo_planner.tasks import InsertPlug, Plug  # noqa: E402


def main():
    """Compute both maps and draw the second."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    wire = Rod.circular(1.0, 3e-3, 8960, 110e9, 0.34)
    hole = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.02)
    # a small cell: held at its beginning the gripper would be outside, held too far ahead as well
    cell = Workspace((-0.45, -1, 0), (0.05, 1, 2))
    inverse = InverseSimulator(DirectSimulator(wire, n_elements=32, basis='local'), workspace=cell)
    depths = np.linspace(0, 0.2, 5)
    print(which_grasp(inverse, Thread(hole, depths), np.linspace(0, 0.6, 7)).summary())
    cable = Rod.circular(0.5, 6e-3, 2500, 6e7, 0.4)
    task = InsertPlug(Pose.looking_along((0.2, 0.2, 0.05), (0, -1, 0)), Plug(0.03, 6e-3, 0.02),
                      max_force=1.5)
    turns = np.linspace(0, np.pi, 7)  # where the cable leaves the plug: backwards, up, forwards
    grasps = [Pose.looking_along((-0.02, 0, 0), (-np.cos(turn), 0, np.sin(turn))) for turn in turns]
    ends = [FarEnd(Pose.looking_along((x, 0, 0), (-1, 0, 0))) for x in np.linspace(-0.2, 0.4, 7)]
    found = which_grasp(InverseSimulator(DirectSimulator(cable, n_elements=32, basis='local')),
                        task, grasps, ends)
    print(found.summary())
    found.plot().savefig(folder / 'which_grasp.png', dpi=100)


if __name__ == '__main__':
    main()
