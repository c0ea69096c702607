"""A simulated checkpoint as a service on a message bus."""
