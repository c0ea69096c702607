r"""Text for people: numbers in words, and escapes for characters that hide or move text.

An escape sequence in a rule's text can fill the clipboard, a bidirectional control can reverse "do
not hold", and a tag character is invisible. Such characters are the control characters (C0, DEL,
C1), all format characters of Unicode (bidirectional, zero-width, tags), lone surrogates, and the
line and paragraph separators. Wherever text leaves the program, each such character is replaced by
its escape: `\x1b`, `\u202e`, `\U000e0041`. The log keeps the true text.
"""

import json
import re
import unicodedata
from collections.abc import Sequence

_FORMAT = (
    "\u00ad\u0600-\u0605\u061c\u06dd\u070f\u0890-\u0891\u08e2\u180b-\u180f\u200b-\u200f\u2028-\u202e"
    "\u2060-\u206f\ufe00-\ufe0e\ufeff\ufff0-\ufffb"
    "\U000110bd\U000110cd\U00013430-\U0001343f\U0001bca0-\U0001bca3\U0001d173-\U0001d17a"
    "\U000e0000-\U000e0fff"
)
_UNSEEN = re.compile(f"[\x00-\x08\x0b-\x1f\x7f-\x9f{_FORMAT}\ud800-\udfff]")
_OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
    "\U000e0000-\U000e007f]"
)


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
    """Write a measured time in seconds, or in milliseconds below one second."""
    if seconds < 0.0005:
        return "<1 ms"
    return f"{seconds * 1000:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"


def visible(text: str) -> str:
    """Return `text` with escapes for characters that control a terminal or are invisible.

    Line feeds and tabs are kept as layout.
    """
    return text if _UNSEEN.search(text) is None else _UNSEEN.sub(_escape, text)


def visible_line(text: str) -> str:
    r"""Return `text` as `visible` does, but on one line: line feeds become `\n`, tabs `\t`."""
    return visible(text).replace("\n", r"\n").replace("\t", r"\t")


def visible_json(document: str) -> str:
    """Return a JSON `document` with JSON escapes for the characters that `visible` escapes.

    Layout and meaning are unchanged: a program that parses the document reads the true text.
    """
    return document if _UNSEEN.search(document) is None else _UNSEEN.sub(_json_escape, document)


def obeyed(text: str) -> str:
    """Return the name of the first character of `text` that no file may contain, or ''.

    Such characters move a cursor, change a terminal or reverse the reading order. Zero-width
    characters are allowed, because some languages join letters with them; they are escaped only in
    output.
    """
    match = _OBEYED.search(text)
    if match is None:
        return ""
    name = unicodedata.name(match[0], "a control character")
    return f"U+{ord(match[0]):04X} ({name.lower()})"


def _json_escape(match: re.Match[str]) -> str:
    return json.dumps(match[0])[1:-1] if ord(match[0]) != 0x7F else "\\u007f"


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    if code <= 0xFF:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
