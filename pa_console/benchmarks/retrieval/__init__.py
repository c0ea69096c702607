"""How good and how fast retrieval is, on labelled queries among many rules."""
