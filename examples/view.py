# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan in the browser: looked at over time, its gripper and its cut-out dragged.

python examples/view.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    Box,
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Pose,
    Rod,
    Workspace,
)
from dlo_planner.tasks import concatenate  # noqa: E402
from dlo_planner.view import view  # noqa: E402

HOSE = Rod.tube(0.8, 0.012, 0.008, 1200.0, 6.0e7, 0.45, natural_curvature=(0.0, 0.4),
                max_bend_curvature=6.0)
HOLE = CutOut(Pose.looking_along((0.0, 0.0, 1.0), (1, 0.3, 0)), radius=0.02)
NOW = Pose.looking_along((-0.9, 0.25, 1.15), (1.0, 0.0, 0.1))
POST = Box(Pose((0.45, 0.45, 0.8), (0, 0, 0, 1)), (0.1, 0.1, 0.4))


def planned():
    """Return the plan from where the gripper is through the hole, and what it was made with."""
    inverse = InverseSimulator(DirectSimulator(HOSE, n_elements=48, n_terms=8),
                               workspace=Workspace(keep_out=[POST], gripper_radius=0.05))
    plan = inverse.thread(HOLE, start=NOW, depths=np.linspace(0, 0.7, 30))
    return concatenate(inverse.approach(HOLE, plan, NOW, standoff=0.05), plan), inverse


if __name__ == '__main__':
    page = view(*planned())
    print(f'open {page.url} in a browser; Ctrl-C ends it')
    page.wait()
