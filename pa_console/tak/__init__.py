"""A session on the maps of others: Cursor on Target for ATAK, WinTAK and TAK servers."""
