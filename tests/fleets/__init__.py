"""Fleets: the messages of the standard, the bus, and a simulated site on it."""
