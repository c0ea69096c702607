"""A session on TAK maps: Cursor on Target for ATAK, WinTAK and TAK servers."""
