"""The dynamic state of a simulated checkpoint."""
