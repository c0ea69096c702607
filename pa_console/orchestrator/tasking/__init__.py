"""Assignment: from the reading of an order to commands for assets, and a plan's gaps."""
