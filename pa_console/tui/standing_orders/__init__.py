"""Standing orders on the screen: what is said of one, and the list of them."""
