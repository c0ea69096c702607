"""The effects of changed rules: in recorded sessions, in the present, in a mission set."""
