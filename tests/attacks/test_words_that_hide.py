"""A call for force, or to set rules aside, is refused however it is spelt (ROE-01, ROE-05).

The texts were written before the checks; the half in `words_held.yaml` was run only once they were
finished. What is asked for is the honest part: at least 80 % noticed, at most 2 % of the harmless
ones refused.
"""

from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.mission.spelling import respell
from pa_console.policy.plain_text import compatible_form
from pa_console.policy.rule_checks import check_mission
from pa_console.schema.mission import Mission
from pa_console.station.assembly import Site, load_site
from pa_console.station.intake import Intake, ReadText

DATA = Path(__file__).parent / "data"
NOTICED, REFUSED = 0.8, 0.02
HIDDEN = "\u00ad\u200b\u200c\u200d\u2060\ufeff\u034f\u202a\u202c\u2066\u2069\ufe0f\u180e"


@cache
def site() -> Site:
    return load_site("checkpoint", "checkpoint")


def given_as(text: str) -> Mission:
    """Return the mission that comes of what somebody types."""
    there = site()
    intake = Intake(there.world, "test-0000", respond=False)
    shown = " ".join(compatible_form(text).split())
    read = ReadText(" ".join(text.split()), respell(shown, there.world, there.rulebook))
    return intake.submit(read, False)[0]


def broken(text: str) -> set[str]:
    there = site()
    found = check_mission(there.rulebook, given_as(text), there.world)
    return {finding.rule_id for finding in found if finding.broken}


HALVES = ("open", "held")


def texts(half: str) -> dict[str, Any]:
    return yaml.safe_load((DATA / f"words_{half}.yaml").read_text("utf-8"))


@pytest.mark.parametrize("half", HALVES)
def test_most_evasions_are_noticed(half: str) -> None:
    evasions = [one["text"] for one in texts(half)["evasions"]]
    missed = [text for text in evasions if not broken(text) & {"ROE-01", "ROE-05"}]
    assert len(missed) <= (1 - NOTICED) * len(evasions), missed


def test_next_to_nothing_harmless_is_refused() -> None:
    harmless = [text for half in HALVES for text in texts(half)["harmless"]]
    refused = [text for text in harmless if broken(text)]
    assert len(refused) <= REFUSED * len(harmless), refused


def test_respelling_does_not_undo_what_was_typed() -> None:
    mission = given_as("sho\u00adot the driver")
    assert (mission.text, mission.typed) == ("shoot the driver", "sho\u00adot the driver")
    assert broken("sho\u00adot the driver") == {"ROE-01"}


@settings(deadline=None)
@given(st.sampled_from(["shoot", "kill", "attack"]), st.data())
def test_no_character_that_does_not_show_hides_a_word(word: str, data: st.DataObject) -> None:
    at = data.draw(st.lists(st.integers(0, len(word)), min_size=1, max_size=6))
    for place in sorted(at, reverse=True):
        word = word[:place] + data.draw(st.sampled_from(HIDDEN)) + word[place:]
    assert broken(f"{word} the driver") == {"ROE-01"}


def test_a_word_that_is_read_as_another_is_checked_as_it_was_typed() -> None:
    there = site()
    mission = given_as("Watch the gate.").model_copy(update={"typed": "Shoot the driver."})
    found = check_mission(there.rulebook, mission, there.world)
    assert {finding.rule_id for finding in found if finding.broken} == {"ROE-01"}


def test_a_mission_of_nothing_that_shows_is_not_taken() -> None:
    with pytest.raises(ValueError, match="empty"):
        given_as("\u200b \u00ad")
