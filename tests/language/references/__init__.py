"""Tests of what orders point at."""
