"""What is streamed, and what may be: without a node."""

from types import SimpleNamespace

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Trajectory,
)
from dlo_planner.ros.execution import Execution, ready
from dlo_planner.ros.proof import Proof

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
PLAN = InverseSimulator(DirectSimulator(WIRE)).thread(
    CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0))), depths=[0.0, 0.1, 0.2])
TOOL = Pose((0, 0, 0.1), (0, 0.6, 0, 0.8))
WAY = Trajectory(PLAN, tolerance=np.inf)
MADE = SimpleNamespace(scene=SimpleNamespace(start_distance=0.02, start_angle=0.1), plan=PLAN)
SAFE = Proof(PLAN, SimpleNamespace(trajectory=WAY), '', True)


def test_commands_go_from_the_first_pose_to_the_last_one_and_end():
    execution = Execution()
    assert execution.command(0.0) is None and not execution.stop()
    execution.start(WAY, TOOL, 'world', 100.0)
    for since, gripper in ((0.0, PLAN.grippers[0]), (WAY.duration + 1, PLAN.grippers[-1])):
        pose, frame = execution.command(100.0 + since)
        assert frame == 'world'
        np.testing.assert_allclose(pose.compose(TOOL).matrix, gripper.matrix, atol=1e-9)
    assert execution.command(101.0) is None  # it was the last one
    execution.start(WAY, TOOL, 'world', 0.0)
    assert execution.stop() and execution.command(0.1) is None


@pytest.mark.parametrize(('change', 'named'), [
    ({'made': None}, 'no plan'), ({'proof': None}, 'still being checked'),
    ({'proof': Proof(None, SAFE.report, '', True)}, 'still being checked'),
    ({'proof': Proof(PLAN)}, 'still being checked'),
    ({'proof': Proof(PLAN, SAFE.report, 'in motion the DLO misses', True)}, 'the DLO misses'),
    ({'now': None}, 'no gripper pose'),
    ({'now': Pose(PLAN.grippers[0].position, (0, 0, 0, 1))}, 'start_angle'),
    ({'now': Pose.identity()}, 'start_distance')])
def test_what_is_missing_is_named(change, named):
    given = {'made': MADE, 'proof': SAFE, 'now': PLAN.grippers[0]}
    assert ready(**given) is WAY  # what was proved, not a motion made again
    with pytest.raises(InvalidTask, match=named):
        ready(**{**given, **change})
