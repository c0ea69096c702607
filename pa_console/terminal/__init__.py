"""The terminal without a screen: what a mission, an approval and a console are drawn in."""
