"""The trace of a mission drawn on the screen, and rows with a hanging indent for every pane."""
