"""The depth of tests that draw what they try: whole in the profile `ci`, a fifth by default."""

from hypothesis import settings

LEAST = 10
"""Fewer examples than these are not cut any more."""


def depth(examples: int) -> int:
    """Return how many of `examples` are tried; `--hypothesis-profile=ci` tries them all."""
    if settings.get_current_profile_name() == "ci":
        return examples
    return max(examples // 5, min(examples, LEAST))
