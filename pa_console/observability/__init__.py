"""Observers of a session: missions as traces, numbers as metrics."""
