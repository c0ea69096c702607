"""The command line in this process, with a key of its own and a scripted LLM."""

from tests.cli.conftest import call, engine

__all__ = ["call", "engine"]
