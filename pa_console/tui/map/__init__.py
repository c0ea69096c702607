"""Draws the checkpoint from above into character cells; knows no widget."""
