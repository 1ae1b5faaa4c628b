# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # A cell in ROS 2
#
# The planner is a node. This script starts one, asks it for a shape and for a plan, and waits
# until the plan is proved. It needs ROS 2, or the wheels of it in `requirements.txt`; in a
# workspace you would start the node with `ros2 launch dlo_planner planner.launch.py`.
import os

import numpy as np

from dlo_planner import Pose
from dlo_planner.ros.child import child
from dlo_planner.ros.client import PlannerClient
from dlo_planner.settings.yaml_files import config_file
from msg_helpers.paths import poses_from_path


def main():
    """Start a node, use it, and return what it said."""
    settings = ('--ros-args', '--params-file', str(config_file('copper_wire')), '-p',
                'rod.diameter:=0.0015', '-p', 'diagnostics_period:=0.2')
    with child('dlo_planner.ros.main', *settings, env=os.environ) as node:
        client = PlannerClient(timeout=30.0)
        try:
            return use(client, lambda: node.poll() is None)
        finally:
            client.close()


# %%
# `PlannerClient` is a thin wrapper; `ros2 service call` and your own node do the same. Services
# are of standard types: `nav_msgs/srv/GetPlan` for shapes and plans, `std_srvs/srv/Trigger`.
def use(client, alive):
    """Predict, plan, wait for the proof."""
    assert client.wait_until_ready(300.0, alive)  # the first start compiles
    level = Pose.looking_along((-1, 0, 1), (1, 0, 0))
    shape, seconds = client.predict_shape(level)
    print(f'{len(shape.poses)} nodes in {1e3 * seconds:.0f} ms')
    plan, seconds = client.plan_threading(level, Pose.looking_along((0, 0, 1), (1, 0, 0)))
    grippers = poses_from_path(plan)
    print(f'{len(grippers)} gripper poses in {seconds:.2f} s')
    proof = client.proof(plan)
    print('proof:', proof['report'], proof['report reason'])
    return shape, np.array([one.position for one in grippers]), proof


if __name__ == '__main__':
    main()

# %%
# From here: `~/execute` streams the proved motion on `~/gripper_command`, `~/observed_points`
# closes the loop, and `ros2 run dlo_planner cell` is a robot with a wire and a camera to try it
# with. `make demo` runs a whole job in it.
