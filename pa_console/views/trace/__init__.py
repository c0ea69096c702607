"""The trace of a mission, laid out once for every front end: screen, terminal, document."""
