"""Draws orders that fit a situation, in all their kinds."""
