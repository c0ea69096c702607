"""Which rule set may rule: the compiled core, the shipped set, the pin of a user, the signature."""
