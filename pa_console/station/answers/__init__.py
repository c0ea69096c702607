"""Answers to questions about the record: reasons, and plans that would do otherwise."""
