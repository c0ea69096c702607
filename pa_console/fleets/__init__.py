"""Fleets that a station can drive: the simulated one, and those on a message bus."""
