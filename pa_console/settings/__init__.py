"""What a user may choose, where each choice comes from, and the file that keeps it."""
