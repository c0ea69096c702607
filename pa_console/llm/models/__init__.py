"""Models by name: their sources, and how they are fetched, checked and prepared."""
