"""Planning: the planner's prompt, the commands that serve an order, and how a plan fulfils it."""
