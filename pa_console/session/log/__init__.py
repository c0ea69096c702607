"""The session log: hash-chained, signed, indexed, witnessed, verified."""
