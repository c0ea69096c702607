"""Drones and ground vehicles over MAVLink: PX4, ArduPilot, and others with the common messages."""
