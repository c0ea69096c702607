"""`pa-console site`: the simulated checkpoint as a service on a message bus."""
