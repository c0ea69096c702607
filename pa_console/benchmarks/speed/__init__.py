"""`pa-console bench`: how fast each part is beside the plain way and the limit."""
