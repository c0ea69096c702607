"""A session: its hash-chained log, its state as a fold over events, its replay and its traces."""
