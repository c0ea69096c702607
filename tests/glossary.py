"""The words that the glossary of the manual has retired, and what is used in their place."""

import re

from pa_console.manual_pages import load_manual

HEADING = "\n## Retired words\n"
ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def retired_words() -> dict[str, str]:
    """Return the word to use for each retired one."""
    rows = dict(ROW.findall(load_manual().find("glossary").text.partition(HEADING)[2]))
    del rows["retired"]
    return rows


def uses(text: str, word: str) -> bool:
    """Return whether `text` has `word`, in any case and over the ends of lines."""
    return bool(re.search(rf"\b{re.escape(word)}", " ".join(text.split()), re.IGNORECASE))
