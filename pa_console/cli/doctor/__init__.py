"""`pa-console doctor`."""
