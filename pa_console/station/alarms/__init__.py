"""Alarms of a site: their causes, the open alarms, and messages about them to people elsewhere."""
