"""`pa-console console --plain`: the console as lines and questions."""
