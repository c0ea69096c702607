"""Lets agents propose missions over the Model Context Protocol; people approve them."""
