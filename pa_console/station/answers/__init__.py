"""Answers to questions about the record: reasons for a plan, and alternatives to it."""
