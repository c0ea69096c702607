"""Planner and judge: their prompts, the grammars of their answers, and the calls to models."""
