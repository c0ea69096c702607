"""`pa-console bench` and the benches below it."""
