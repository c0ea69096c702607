"""Recorded sessions in the formats of other tools: Markdown, MCAP, SVG and asciinema casts."""
