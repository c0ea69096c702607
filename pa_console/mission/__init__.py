"""The steps of one mission, one module a step, and the gate before the fleet."""
