"""Puts orders into the words of operators, from phrase banks."""
