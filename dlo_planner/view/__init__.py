"""Pictures of shapes and plans, and a page in the browser that shows them; no ROS in here."""
