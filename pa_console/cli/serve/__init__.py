"""The verb `serve`: a session for other programs, or the console in a browser."""
