"""Parameters: one table, read from YAML, and what their values describe; no ROS in here."""
