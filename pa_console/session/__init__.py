"""The session's memory: hash-chained log, the fold over events, replay."""
