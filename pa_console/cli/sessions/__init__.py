"""The sessions that verbs open: live, joined, served, followed and recorded."""
