"""A session for other programs: a small HTTP interface on loopback, behind tokens and roles."""
