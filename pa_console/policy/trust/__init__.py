"""The trust in rule sets: the compiled core, the shipped set, a user's pin, the signature."""
