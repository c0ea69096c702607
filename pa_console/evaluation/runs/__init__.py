"""The runs of an evaluation: which there are, how one is made, what is kept of it."""
