"""The controllers of the operator's actions, one for each concern."""
