"""Worlds: their files, ground and routes, and generated worlds."""
