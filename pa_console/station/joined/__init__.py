"""Joined consoles, which show the session of another station."""
