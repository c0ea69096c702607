"""The language of orders: their canonical words, grammars, conditions and names."""
