"""What changed rules would change: in recorded sessions, in the present, in a mission set."""
