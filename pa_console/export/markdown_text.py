"""Pieces of GitHub Flavored Markdown in which a text shows as it is, whatever it contains."""

import re
from collections.abc import Iterable, Sequence
from html import escape

from pa_console.schema.visible import visible, visible_line

_SPECIAL = re.compile(r"[\\`*\[\]<>#|~&$]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")
_LIST_MARK = re.compile(r"^(\s*)(?:([-+=:])|(\d+)([.)])(?=\s|$))")
_LINK = re.compile(r"(?i)\b(https?|ftp)://|\bwww\.")
_BREAKS = re.compile(r"\r\n|[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]")


def inline(text: str) -> str:
    """Return `text` for one line of Markdown; line breaks in it become `<br>`."""
    return "<br>".join(_line(line) for line in _BREAKS.split(text.strip()))


def _line(text: str) -> str:
    """Escape one line: no emphasis, link, HTML, table cell or list begins in it."""
    text = visible(text.strip())
    linked = _LINK.sub(lambda found: found[0].replace(":", "\0").replace(".", "\1"), text)
    marked = _SPECIAL.sub(r"\\\g<0>", linked).replace("\0", r"\:").replace("\1", r"\.")
    return _LIST_MARK.sub(_escaped_mark, marked)


def _escaped_mark(found: re.Match[str]) -> str:
    return f"{found[1]}\\{found[2]}" if found[2] else f"{found[1]}{found[3]}\\{found[4]}"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; `rows` are plain values, escaped here, None and empty ones as a dash."""
    lines = [heads, ["---"] * len(heads)]
    lines += [[inline(str(cell)) if cell not in (None, "") else "–" for cell in r] for r in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def fenced(text: str, language: str = "text") -> str:
    """Return `text` as a code block whose fence is longer than any run of backticks in it."""
    runs = [len(run) for run in re.findall(r"`+", text)]
    fence = "`" * max([3, *(length + 1 for length in runs)])
    body = "\n".join(visible(line) for line in _BREAKS.split(text))
    return f"{fence}{language}\n{body}\n{fence}"


def folded(summary: str, body: str) -> str:
    """Return `body` folded away under `summary`, a plain text."""
    return f"<details>\n<summary>{escape(visible_line(summary))}</summary>\n\n{body}\n\n</details>"
