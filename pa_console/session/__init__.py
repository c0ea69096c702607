"""Sessions: the hash-chained log, the state folded from events, replay and mission traces."""
