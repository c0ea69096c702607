"""Consoles that join the session of another station."""
