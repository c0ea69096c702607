"""The steps of one mission, one module per step, and the gate in front of the fleet."""
