"""The panel on which the operator decides about a plan: its rows, fields and other plans."""
