"""The Textual console: screens, widgets, actions and theme."""
