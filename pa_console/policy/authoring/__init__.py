"""Writing rules: edit, save, compare, run their examples, find what is doubtful."""
