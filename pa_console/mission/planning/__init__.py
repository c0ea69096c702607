"""Planning: the planner's prompt, the commands that serve an order, how far a plan fulfils it."""
