"""Standing orders: the state of the picture or the time for which each of them waits."""
