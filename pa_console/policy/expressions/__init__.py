"""CEL expressions of rules: compiled, bounded in size and in time."""
