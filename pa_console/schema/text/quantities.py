"""Numbers as people read them: how many of a thing, how long something took, which of many."""

from collections.abc import Sequence


def count(number: int, thing: str) -> str:
    """Write a number of things, e.g. `1 gate` or `3 gates`."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def few(names: Sequence[str], most: int = 3) -> str:
    """Name at most `most` of `names`, and count the rest."""
    more = len(names) - most
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:most])} and {more} more"


def clock_text(seconds: float) -> str:
    """Write a duration as h:mm:ss, or mm:ss below one hour."""
    whole = int(seconds)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02}:{left:02}" if hours else f"{minutes:02}:{left:02}"


def duration_text(seconds: float) -> str:
    """Write a measured time with a unit a person can compare: ms below one second."""
    if seconds < 0.0005:
        return "<1 ms"
    return f"{seconds * 1000:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"
