"""The map of the site in character cells, independent of widgets."""
