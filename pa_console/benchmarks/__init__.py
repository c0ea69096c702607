"""Benchmarks: every part against the plain way of doing it, or against its limit."""
