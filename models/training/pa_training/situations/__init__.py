"""Situations to train in: random worlds, and what has happened there before a command."""
