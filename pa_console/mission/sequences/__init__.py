"""Plans of several steps and patrols: planned one step after another, and carried out so."""
