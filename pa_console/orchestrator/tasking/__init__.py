"""From the reading of an order to commands: who does what, and what a plan lacks."""
