"""A session for other programs: a small HTTP interface on loopback, with tokens and roles."""
