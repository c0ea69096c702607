"""The state that every view shows: the fold over events."""
