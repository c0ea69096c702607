"""Questions that are typed where missions are: who answers them, and the panel that shows it."""
