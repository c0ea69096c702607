"""The language of orders: what an order is, its canonical words and grammar, conditions, names."""
