"""Everything that happens, as typed events: the spine of the console."""
