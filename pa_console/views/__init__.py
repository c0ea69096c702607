"""Presentation models: a session, its missions and its log as plain data and words."""
