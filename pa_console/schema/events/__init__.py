"""Typed events: everything that happens in a session."""
