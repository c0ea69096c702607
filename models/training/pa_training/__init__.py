"""Training: makes data from simulated missions and trains the adapters that ship with the console.

It uses the console and is no part of it: it is in the source tree only.
"""

from pathlib import Path

LANGUAGE = Path(__file__).resolve().parents[1] / "language"
"""Phrases by several authors, which orders are worded with."""

CONFIGS = LANGUAGE.with_name("configs")
"""The configurations that the training of the shipped adapters begins with."""
