"""Fleets on a message bus with VDA 5050, version 3, and the simulated site on such a bus."""
