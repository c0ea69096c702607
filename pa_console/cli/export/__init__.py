"""`pa-console export`."""
