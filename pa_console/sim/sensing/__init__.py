"""Sensing in the simulation: detections, evidence, tracks, and trust in reported positions."""
