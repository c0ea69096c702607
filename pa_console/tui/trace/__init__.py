"""The trace of a mission as sections of rows, for the screen and for copying alike."""
