"""Sensors, detections and the station's tracks."""
