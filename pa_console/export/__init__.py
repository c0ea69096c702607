"""Recorded sessions in other tools' formats: Markdown, MCAP, SVG and asciinema casts."""
