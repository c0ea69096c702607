"""The verb `console`: the screen or lines over one live session."""
