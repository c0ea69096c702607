"""The deterministic checks of a plan (paper, Section IV-F)."""
