"""`pa-console tak`."""
