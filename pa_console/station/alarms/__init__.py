"""Alarms of a site: their causes, the open ones, and alerts about them beyond the screen."""
