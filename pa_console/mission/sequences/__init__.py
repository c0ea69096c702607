"""Patrols and orders in steps, which are planned and carried out one step after another."""
