"""Models by name, their sources, and the code that fetches, checks and prepares them."""
