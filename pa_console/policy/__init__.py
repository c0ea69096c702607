"""The rulebook, its retrieval and its deterministic checks; it knows no simulator."""
