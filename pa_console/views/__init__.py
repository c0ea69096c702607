"""Presentation models: a session, its missions and its record as plain data and words."""
