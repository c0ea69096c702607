"""How long an operator waits for the command line, the screen and the model."""
