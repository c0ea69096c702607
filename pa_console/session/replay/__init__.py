"""A recorded session: opened at once, played into the same state, searched and compared."""
