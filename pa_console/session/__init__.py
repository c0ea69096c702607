"""Sessions: the hash-chained log, the state folded from its events, replay, mission traces."""
