"""Tests of drones over MAVLink."""
