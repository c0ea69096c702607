"""Cursor on Target."""
