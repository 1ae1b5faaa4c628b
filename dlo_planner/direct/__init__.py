"""From gripper poses to shapes."""
