"""The control station: one fleet, one mission queue, one log of everything that happens."""
