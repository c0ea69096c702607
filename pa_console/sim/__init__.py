"""The 2D checkpoint simulation; it knows nothing of LLMs, rules or screens."""
