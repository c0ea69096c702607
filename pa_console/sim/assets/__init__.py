"""Assets: what devices do with commands, how they move, what stops them."""
