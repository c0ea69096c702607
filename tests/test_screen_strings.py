"""Every text of the screen: one spelling, one word for one thing, no names from inside."""

import re
from collections.abc import Iterator

import pytest

from pa_console.schema.command import COMMANDS
from pa_console.settings.schema import Settings
from tests.glossary import retired_words, uses
from tests.screen_strings import Shown, literal, shown_strings

AMERICAN = (
    "color", "behavior", "center", "gray", "canceled", "canceling", "labeled", "traveled",
    "neighbor", "favor", "honor", "defense", "artifact", "catalog", "modeled", "signaled",
    "analyze", "fulfill",
)  # fmt: skip
"""The screen is British, with -ize as in *unauthorized*; these are not."""
SYNONYMS = {
    "abort": "cancel a mission, halt a plan, stop everything",
    "waypoint": "way",
    "emergency stop": "stop",
    "operating picture": "common operational picture, picture",
}
"""Words of the standards that robots speak, which the screen does not use, and its own."""
IDENTIFIER = re.compile(r"(?<![\w.-])[a-z]+(?:_[a-z0-9]+)+(?!\w)")
FIELDS = frozenset(
    ("at_s", "radius_m", "floor_m", "ceiling_m", "off_by_m", "in_prompts", "occupied_thresh")
)
"""Fields of files that people write, named where one is wrong."""
QUOTED = ("pa_console/tui/", "pa_console/session/", "pa_console/views/")
"""Where values are quoted as people quote them."""


@pytest.fixture(scope="module")
def shown() -> list[Shown]:
    """Return every text once for all tests."""
    return shown_strings()


def told(found: Iterator[tuple[Shown, str]]) -> list[str]:
    return [f"{each.file}:{each.line}: {why}: {each.text[:70]}" for each, why in found]


def test_the_table_holds_the_texts_of_the_screen(shown: list[Shown]) -> None:
    texts = {each.text for each in shown}
    assert len(shown) > 2000
    assert "Go to the plan that waits for a decision" in texts
    assert "each mission waits for your approval" in texts
    assert any(each.file == "pa_console/views/event_words.py" for each in shown)


def test_spelling_is_british(shown: list[Shown]) -> None:
    american = re.compile(rf"\b(?:{'|'.join(AMERICAN)})(?:s|ed|ing|ful)?\b", re.IGNORECASE)
    found = ((s, m[0]) for s in shown if (m := american.search(literal(s.text))))
    assert told(found) == []


def test_one_word_means_one_thing(shown: list[Shown]) -> None:
    found = (
        (each, f"{word!r} is {right!r} in the glossary")
        for each in shown
        for word, right in {**SYNONYMS, **retired_words()}.items()
        if uses(literal(each.text), word)
    )
    assert told(found) == []


def test_no_name_from_inside_the_program_is_shown(shown: list[Shown]) -> None:
    known = {*COMMANDS, *FIELDS, *Settings.model_fields}
    found = (
        (each, name)
        for each in shown
        for name in IDENTIFIER.findall(literal(each.text))
        if name not in known
    )
    assert told(found) == []


def test_values_are_not_written_as_python_writes_them(shown: list[Shown]) -> None:
    here = (each for each in shown if each.reprs and each.file.startswith(QUOTED))
    assert told((each, ", ".join(each.reprs)) for each in here) == []
