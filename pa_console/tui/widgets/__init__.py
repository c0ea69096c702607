"""Widgets that stand alone, each with its own messages and CSS."""
