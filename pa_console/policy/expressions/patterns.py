"""The regular expressions of rules: searched in time that grows with the text, and never longer.

RE2 takes what it can: its time is linear in the text, whatever the pattern. It knows letters of
ASCII only, so texts with others, and patterns that look ahead or behind, are searched by a
backtracking engine that stops when the check's time is up. Both mean the same by a pattern.
"""

import re
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from typing import Any, TypeVar

import regex

from pa_console.policy.expressions.deadlines import DeadlineError, give_up, left_s

_re2: Any = import_module("re2")
"""The library has no type information."""

T = TypeVar("T")
MAX_PATTERN = 16_384
MAX_PROGRAM = 12_000
"""Steps of a pattern in RE2, which go once through the text each at worst."""
MAX_TEXT = 10_000
"""Characters of a text that is searched; a mission has at most 2,000."""

_ESCAPED_OR_CLASS = re.compile(r"\\(?s:.)|\[\^?\]?(?:\\(?s:.)|[^\]\\])*\]|\s+|#[^\n]*")
_LOOKS = re.compile(r"(\\(?s:.)|\[\^?\]?(?:\\(?s:.)|[^\]\\])*\])|\(\?<?[=!]")
_VERBOSE = re.compile(r"\s*\(\?x\)")


class Pattern:
    """A compiled pattern; raises ValueError for one that is not supported, with the reason."""

    def __init__(self, source: str) -> None:
        """Compile `source` for both engines."""
        if len(source) > MAX_PATTERN:
            raise ValueError(f"too long: {len(source):,} characters, at most {MAX_PATTERN:,}")
        try:
            re.compile(source)
        except (re.error, RecursionError, OverflowError) as error:
            raise ValueError(f"not a regular expression: {error}") from error
        plain = _without_layout(source)
        looking = _LOOKS.sub(lambda found: found[1] or "(?:", plain)
        linear = _linear(looking)
        self._linear = linear if looking == plain else None
        self._any: regex.Pattern[str] = regex.compile(source)

    def search(self, text: str) -> bool:
        """Return whether the pattern matches somewhere in `text`."""
        left = _left(text)
        if self._linear is not None and text.isascii():
            return self._linear.search(text) is not None
        return _in_time(
            lambda limit: self._any.search(text, concurrent=False, timeout=limit) is not None, left
        )

    def cut(self, text: str, mark: str) -> str:
        """Return `text` with every match replaced by `mark`."""
        left = _left(text)
        if self._linear is not None and text.isascii():
            return str(self._linear.sub(mark, text))
        return _in_time(
            lambda limit: self._any.sub(mark, text, concurrent=False, timeout=limit), left
        )


@lru_cache(maxsize=1024)
def pattern(source: str) -> Pattern:
    """Return the pattern `source`, compiled once; raises ValueError."""
    return Pattern(source)


def _linear(source: str) -> Any:
    """Return `source` compiled by RE2; raises ValueError for what no engine without memory does."""
    options = _re2.Options()
    options.log_errors = False
    try:
        compiled = _re2.compile(source.replace(r"\Z", r"\z"), options)
    except _re2.error as error:
        problem = error.args[0].decode() if error.args else "not supported"
        raise ValueError(
            f"{problem}: backreferences, possessive and atomic groups, conditions and very large "
            "repetitions are not supported"
        ) from error
    if compiled.programsize > MAX_PROGRAM:
        raise ValueError(
            f"too large: {compiled.programsize:,} steps, at most {MAX_PROGRAM:,}; "
            "repeat less, or split the pattern"
        )
    return compiled


def _left(text: str) -> float | None:
    """Return the seconds that there are for a search of `text`; raises where it may not begin."""
    if len(text) > MAX_TEXT:
        raise ValueError(f"a text of {len(text):,} characters is not searched")
    left = left_s()
    if left == 0.0:
        raise DeadlineError("no time is left for a pattern")
    return left


def _in_time(search: Callable[[float | None], T], left: float | None) -> T:
    """Return what `search` finds within `left` seconds; raises DeadlineError when it takes longer.

    The engine counts what all threads of the process compute. A search that it broke off before
    this thread has used up its own time is made again. It keeps the interpreter's lock: where it
    lets go of that, it asks for it again every few steps, which beside a thread that computes
    takes a hundred times as long as the search.
    """
    while True:
        try:
            return search(left)
        except TimeoutError as error:
            left = left_s()
            if not left:
                give_up()
                raise DeadlineError("a pattern took too long") from error


def _without_layout(source: str) -> str:
    """Return a verbose pattern without its spaces and comments, which RE2 does not know."""
    begins = _VERBOSE.match(source)
    if begins is None:
        return source
    return _ESCAPED_OR_CLASS.sub(
        lambda found: found[0] if found[0][0] in "\\[" else "", source[begins.end() :]
    )
