"""The Model Context Protocol: agents propose missions, and people approve them."""
