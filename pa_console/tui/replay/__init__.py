"""Recorded sessions in the console: opened, driven, and compared."""
