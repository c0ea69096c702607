"""Which rules concern a mission: rankings and their fusion (paper, Steps 2 and 3)."""
