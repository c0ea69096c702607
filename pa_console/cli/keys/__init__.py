"""The verb `keys`, and the keys that other verbs sign with."""
