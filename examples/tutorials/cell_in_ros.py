# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # A cell in ROS 2
#
# The planner is a node. This script starts one, asks it for a shape and for a plan, and waits
# until the plan is proved. It needs ROS 2, or the wheels of it in `requirements.txt`; in a
# workspace you would start the node with `ros2 launch dlo_planner planner.launch.py`.
import signal
import subprocess
import sys

import numpy as np
import rclpy

from dlo_planner import CutOut, Pose, Thread
from dlo_planner.ros.client import DloCommander
from dlo_planner.settings.yaml_files import config_file
from msg_helpers.trajectories import poses_from_path


def main():
    """Start a node, use it, and return what it said."""
    node = subprocess.Popen([sys.executable, '-m', 'dlo_planner.ros.main', '--ros-args',
                             '--params-file', str(config_file('copper_wire')),
                             '-p', 'rod.diameter:=0.0015', '-p', 'rod.length:=1.0'])
    rclpy.init()
    robot = DloCommander()
    try:
        return use(robot)
    finally:
        robot.destroy_node()
        rclpy.shutdown()
        node.send_signal(signal.SIGINT)
        node.wait()


# %%
# `DloCommander` is a thin wrapper; `ros2 service call` and your own node do the same. Services
# are of standard types: `nav_msgs/srv/GetPlan` for shapes and plans, `std_srvs/srv/Trigger`. What
# the node refuses is raised as `Refused`, with the reason and its number.
def use(robot):
    """Predict, plan, wait for the proof."""
    robot.wait_until_active()  # the first start compiles
    level = Pose.looking_along((-1, 0, 1), (1, 0, 0))
    shape = robot.predict(level)
    print(f'{len(shape)} nodes')
    task = Thread(CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.005))
    plan = robot.plan(task, start=level)
    grippers = poses_from_path(plan)
    print(f'{len(grippers)} gripper poses')
    proof = robot.proof(plan)
    print('proof:', proof['report'], proof['duration [s]'], 's')
    return shape, np.array([one.position for one in grippers]), proof


if __name__ == '__main__':
    main()

# %%
# From here: `robot.execute(plan)` streams the proved motion on `~/gripper_command`,
# `~/observed_points` closes the loop, and `ros2 run dlo_planner cell` is a robot with a wire and a
# camera to try it with. `make demo` runs a whole job in it.
