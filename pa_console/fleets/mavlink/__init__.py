"""Drones over MAVLink: PX4, ArduPilot, and whatever else speaks the common messages."""
