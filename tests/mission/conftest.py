"""The station with a scripted LLM that tests of the mission run on."""

from tests.rig import rig, site

__all__ = ["rig", "site"]
