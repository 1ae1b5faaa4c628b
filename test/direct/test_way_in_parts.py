# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The way to where a step begins: in so many parts, and what is said where that is not enough."""

from dlo_planner import Capsule, CutOut, DirectSimulator, Pose, Rod, Sheet
from dlo_planner.direct import step

STRIP = Rod.rectangular(length=0.6, width=0.012, thickness=6e-4, density=7850.0,
                        youngs_modulus=200e9, poisson_ratio=0.3)
HOLE = CutOut(Pose((0.380741, 0.0566812, 0.919323), (-0.013, 0.175, 0.0727, 0.9818)),
              width=0.03, height=0.02)
BAR = Capsule((0.267433, -0.160187, 0.913228), (0.267433, 0.239813, 0.913228), 0.01)


def grippers(count):
    """Return poses that move a strip, which hangs through a hole, toward the hole's rim."""
    return [Pose((-0.003 * k, 0.007 * k, 1 + 0.001 * k),
                 (0.0027 - 0.00127 * k, -0.0358 - 0.00444 * k, 0.0738 - 0.00545 * k, 0.9966))
            for k in range(count)]


def test_what_takes_too_many_parts_is_given_up_and_said(monkeypatch):
    made, relax = [], step.minimum

    def counted(*arguments):
        made.append(None)
        return relax(*arguments)
    monkeypatch.setattr(step, 'minimum', counted)
    among = DirectSimulator(STRIP, obstacles=[Sheet.around(HOLE, thickness=0.0), BAR])
    start, *before, last = grippers(4)
    shape = DirectSimulator(STRIP).solve(start)
    for gripper in before:
        shape = among.solve(gripper, shape)
    made.clear()
    arrived = among.solve(last, shape)
    assert arrived.converged and not arrived.jumped and len(made) > 100  # along the rim
    monkeypatch.setattr(step, '_MORE_PARTS', 20)
    made.clear()
    stuck = among.solve(last, shape)
    assert len(made) == 21
    assert not stuck.converged or stuck.jumped
