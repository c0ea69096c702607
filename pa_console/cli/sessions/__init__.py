"""The sessions that verbs open: live, joined, served, followed or recorded."""
