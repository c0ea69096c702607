"""Standing orders, which wait for a state of the picture or for a time."""
