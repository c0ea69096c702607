"""A console that has joined the session of another station."""
