"""The one registry of actions, its keys, and the command palette that is made from it."""
