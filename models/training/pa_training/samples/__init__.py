"""Training samples: prompts with the answers that are wanted, and the data sets made of them."""
