"""Fleets that a station can drive: the protocol of one, and the simulated fleet."""
