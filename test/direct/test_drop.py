# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that falls onto a plane: quick, with an error that it knows."""

import numpy as np

from dlo_planner import DirectSimulator, Plane, Pose, Rod
from dlo_planner.direct.stepper import Stepper

LEVEL = Pose((0, 0, 0), (0, 0, 0, 1))
CABLE = Rod(1.0, 0.1, 0.02, 0.015, radius=0.005, damping=1e-3)
FLOOR = Plane((0, 0, -0.2), (0, 0, 1))


def dropped(instants, dt, friction=0.0, **options):
    """Return the Motion of a cable that is straight and level at first."""
    straight = DirectSimulator(CABLE, gravity=(0, 0, 0), **options).solve(LEVEL)
    floor = Plane(FLOOR.point, FLOOR.normal, friction)
    return DirectSimulator(CABLE, obstacles=[floor], **options).simulate(
        [LEVEL] * instants, dt, straight)


def test_the_error_of_a_drop_is_known():
    motion = dropped(25, 0.01)
    assert motion.status == 'complete' and motion.shapes[-1].contacts
    estimate = motion.error_estimate
    # four times the steps, twice the elements
    finer = dropped(97, 0.0025, n_elements=128, basis='local')
    assert finer.status == 'complete'
    shapes = zip(finer.shapes[::4], motion.shapes, strict=True)
    true = np.maximum.accumulate([np.linalg.norm(one.positions[::2] - other.positions, axis=1).max()
                                  for one, other in shapes])
    assert true[-1] > 1e-3  # the impact counts
    assert (true <= estimate).all() and estimate[-1] < 5 * true[-1]
    # an impact takes energy, and gives none
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)


def test_few_steps_of_a_drop_are_made_in_vain(monkeypatch):
    found, steps = [], Stepper.steps

    def seen(*given):
        batch = steps(*given)
        found.append((len(batch.errors), batch.refused is not None))
        return batch

    monkeypatch.setattr(Stepper, 'steps', seen)
    for friction in (0.0, 0.3):
        found.clear()
        motion = dropped(41, 0.01, friction)
        assert motion.status == 'complete' and len(motion.shapes[-1].contacts) > 1
        good, refused = np.sum(found, axis=0)
        # about 300, and twice as many where contacts pull
        assert good + refused < 450
        # begun where the motion leads, else 19
        assert np.median([shape.iterations for shape in motion.shapes[1:]]) < 6
