"""The planner and the judge: their prompts, the grammars of their answers, and the calls."""
