"""Fleets that a station can drive, simulated or real, and the protocol that all of them follow."""
