"""Core objects of `dlo_planner` to ROS messages and back; nothing else."""
