"""Independent widgets, each with its own messages and CSS."""
