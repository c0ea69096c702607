"""Worlds: their files, their ground and routes, and generated ones."""
