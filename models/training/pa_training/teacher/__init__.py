"""The reference planner: an order and the situation in, plans to be verified out."""
