"""Answers to questions about the record, such as reasons for a plan and alternatives to it."""
