"""Orders before a plan: their spelling, and the orders that wait for a state or a moment."""
