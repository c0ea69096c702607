"""The panel on which the operator decides about a plan."""
