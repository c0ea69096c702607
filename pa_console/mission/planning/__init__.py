"""Planning: the planner's prompt, commands for a reading, and a plan's match with a reading."""
