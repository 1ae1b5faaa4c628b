"""From a task to gripper poses."""
