"""`pa-console mission`."""
