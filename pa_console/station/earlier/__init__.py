"""The continuation of an earlier session: its open parts, and the start of the new session."""
