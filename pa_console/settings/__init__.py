"""The settings, with their schema, their sources and the user's file."""
