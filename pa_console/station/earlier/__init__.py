"""Continuing after an earlier session: what it left open, and how a new session begins."""
