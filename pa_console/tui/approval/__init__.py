"""The panel for the operator's decision on a plan: its rows, its inputs and other plans."""
