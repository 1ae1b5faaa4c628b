"""A cell to try plans in: a DLO in a physics engine that shares no code with the planner."""
