"""`pa-console replay`."""
