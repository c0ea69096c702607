"""Retrieval of the rules that concern a mission: rankings and fusion (paper, Steps 2 and 3)."""
