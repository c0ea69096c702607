"""Standing orders: those that wait for a state of the picture, and those that wait for a time."""
