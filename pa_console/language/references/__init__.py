"""References in an order, and the names that they mean in the picture or in earlier orders."""
