"""CEL expressions of rules: compiled, with limits on size and time."""
