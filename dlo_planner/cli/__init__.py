"""The command `dlo-planner`: the library at the terminal, without ROS."""
