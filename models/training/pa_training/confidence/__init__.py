"""How often an order was understood, told from what the models say: the data, and the fit."""
