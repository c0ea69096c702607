"""`pa-console rules`."""
