"""Questions of the operator about what the console has proposed or done: which they are."""
