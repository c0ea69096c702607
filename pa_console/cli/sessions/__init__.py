"""The sessions that verbs open, which are live, joined, served, followed or recorded."""
