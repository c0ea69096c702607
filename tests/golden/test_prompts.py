"""Every prompt, grammar and canonical text is what it was, to the letter.

`prompts.json` holds the beginning of the SHA-256 of each; `prompts/` has the readable text of most
of those for the ten missions of the paper.
"""

from functools import cache

import pytest

from tests.golden.prompt_cases import PAPER, cases, everything
from tests.golden.stored import HERE, compare, read, sha256, write, write_text

pytestmark = pytest.mark.long

DIGITS = 20
"""Of a SHA-256: enough to tell texts apart."""
READABLE_CHARS = 5000
"""Of longer texts, such as the grammars of whole plans, the first of some kinds are readable."""
LONG = ("grammar compact plan", "grammar compact opening", "clauses")
LOOK = (
    "See a text as it is now with: python -m tests.golden.record show MISSION NAME\n"
    "(and as it was with the same at the commit that last changed prompts.json)"
)


def record() -> None:
    """Write what is so now."""
    texts = _texts()
    write("prompts.json", _hashes(texts))
    for name, text in _readable(texts).items():
        write_text(f"prompts/{name}.txt", text)


def show(mission: str, name: str = "") -> str:
    """Return one text for a mission as it is now; without a `name`, all names."""
    case = next(case for case in cases() if case.name == mission)
    texts = everything(case)
    return texts[name] if name else "\n".join(texts)


def test_readable_prompts_are_the_same() -> None:
    stored = {name: (HERE / f"prompts/{name}.txt").read_text(encoding="utf-8") for name in PAPER}
    lines = {name: text.splitlines() for name, text in stored.items()}
    now = {name: text.splitlines() for name, text in _readable(_texts()).items()}
    compare("prompts", lines, now, "The stored texts are in tests/golden/prompts/MISSION.txt.")


def test_every_prompt_and_grammar_is_the_same() -> None:
    compare("prompts", read("prompts.json"), _hashes(_texts()), LOOK)


@cache
def _texts() -> dict[str, dict[str, str]]:
    return {case.name: everything(case) for case in cases()}


def _hashes(texts: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    return {
        mission: {name: sha256(text)[:DIGITS] for name, text in named.items()}
        for mission, named in texts.items()
    }


def _readable(texts: dict[str, dict[str, str]]) -> dict[str, str]:
    """Return a file for each mission of the paper; a text that was there before is named only."""
    seen: dict[str, str] = {}
    files: dict[str, str] = {}
    first = next(iter(PAPER))
    for mission in PAPER:
        parts: list[str] = []
        for name, text in texts[mission].items():
            where = seen.setdefault(text, f"{mission}, {name}")
            if where != f"{mission}, {name}":
                parts.append(f"==== {name}: as {where}\n")
            elif len(text) > READABLE_CHARS and not (name in LONG and mission == first):
                parts.append(f"==== {name}: {len(text)} characters, see prompts.json\n")
            else:
                parts.append(f"==== {name}\n{text}\n")
        files[mission] = "".join(parts)
    return files
