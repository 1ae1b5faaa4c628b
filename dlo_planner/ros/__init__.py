"""The ROS 2 node, its client and the demo."""
