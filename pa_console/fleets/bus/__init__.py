"""Fleets on a message bus: the station's side, and the connection to an MQTT broker."""
