"""Answers to the operator's questions, from the record and from checks; no model is asked."""
