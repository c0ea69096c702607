"""The canonical words of an order: its asks, their clauses, and the facts of its conditions."""
