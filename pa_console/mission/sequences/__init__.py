"""Patrols and orders in steps: planned and carried out one step after another."""
