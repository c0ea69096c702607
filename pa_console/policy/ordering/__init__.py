"""Rules about the order of events, followed through a mission (WF-01)."""
