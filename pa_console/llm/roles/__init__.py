"""Planner and judge: their prompts, the grammars of their answers, and how models are spoken to."""
