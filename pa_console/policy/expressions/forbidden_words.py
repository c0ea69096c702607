"""Requests that no mission may make, in words that no list of violent verbs contains.

Rules call these functions in addition to their own patterns, which are literal and in English. This
module covers other languages, euphemisms and idioms (`forbidden_words.yaml`). All functions read
plain words (`plain_text.py`). A negation before a phrase reverses its meaning, unless the phrase is
about restraint: *do not refrain from opening fire*. Some requests will not be detected. Even then,
no command for force exists, and the other checks run whatever a mission says.
"""

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import yaml

from pa_console.policy.expressions.deadlines import unmeasured


@cache
def forbidden_patterns() -> Mapping[str, re.Pattern[str]]:
    """Return the patterns of the file, with the names of parts replaced by the parts.

    They are compiled on first use. This takes 50 ms, which do not count towards the check's time
    limit.
    """
    with unmeasured():
        text = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
        loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
        loaded: dict[str, dict[str, str]] = yaml.load(text, loader)
        parts: dict[str, str] = {}

        def filled(source: str) -> str:
            return re.sub(r"<(\w+)>", lambda name: parts[name[1]], source)

        for name, source in loaded["parts"].items():
            parts[name] = filled(source)
        return {
            name: re.compile(filled(source), re.VERBOSE)
            for name, source in loaded["patterns"].items()
        }


def asks_for_force(words: str) -> bool:
    """Return whether plain `words` ask for violence in other languages, idioms or euphemisms."""
    if forbidden_patterns()["forborne"].search(words) is not None:
        return True
    return _meant(words, "force", "force_abroad")


def asks_to_confine(words: str) -> bool:
    """Return whether plain `words` ask to shut a person in, by idiom or by consequence."""
    return _meant(words, "confinement")


def asks_to_follow(words: str) -> bool:
    """Return whether plain `words` ask to follow a person wherever that person goes."""
    return _meant(words, "following")


def asks_to_set_rules_aside(words: str) -> bool:
    """Return whether plain `words` ask to set rules or safety aside, in any wording."""
    return _meant(words, "aside", "aside_abroad")


def _meant(words: str, *names: str) -> bool:
    """Return whether one of the patterns occurs in `words` without a negation."""
    patterns = forbidden_patterns()
    for name in names:
        for match in patterns[name].finditer(words):
            before = re.split(r"[.,;:!?]", words[: match.start()])[-1]
            negated = patterns["negation_before"].search(before)
            if not negated and not patterns["negation_after"].search(words[match.end() :]):
                return True
    return False
