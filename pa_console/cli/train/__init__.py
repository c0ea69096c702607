"""`pa-console train`."""
