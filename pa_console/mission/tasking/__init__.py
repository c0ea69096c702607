"""Who goes: the commands that serve an order, and how far a plan fulfils it."""
