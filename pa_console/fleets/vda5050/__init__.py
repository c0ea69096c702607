"""VDA 5050, version 3: fleets on a message bus, and the simulated site that is such a fleet."""
