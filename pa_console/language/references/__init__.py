"""References in an order that stand for names: found in the picture and in earlier orders."""
