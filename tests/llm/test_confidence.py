"""How sure a model was of its words: the chances of its own choices, none of what was forced."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.llm.backend import Chance, confidence
from pa_console.llm.roles.planner import Planner
from pa_console.llm.roles.prompts import Prompt
from tests.scripted import ScriptedEngine, plan

CHANCES = st.lists(st.tuples(st.integers(0, 40), st.floats(-9.0, 0.0)), min_size=1, max_size=12)
ASKED = "asked: 1 drone home; "
ANSWER = plan(("Drone_T04", "return_to_base"), reason=f"{ASKED}Free drone: Drone_T04")


@given(CHANCES, st.integers(0, 40))
def test_words_that_follow_each_other_are_as_likely_as_both(chances: list[Chance], at: int) -> None:
    text = "".join(chr(0x4E00 + n) for n in range(41))
    first, second = confidence(chances, text, text[:at]), confidence(chances, text, text[at:])
    whole = confidence(chances, text, text)
    assert whole is not None
    assert second is not None
    assert whole == pytest.approx((first or 0.0 if at else 1.0) * second, abs=1e-4)


def test_what_the_model_was_given_no_choice_about_is_certain() -> None:
    assert confidence([(0, -1.0), (9, -1.0)], "one, two, three", "two") == 1.0


@pytest.mark.parametrize(("chances", "words"), [([], "one"), ([(0, -1.0)], ""), ([(0, -1.0)], "x")])
def test_without_chances_or_without_the_words_nothing_is_said(
    chances: list[Chance], words: str
) -> None:
    assert confidence(chances, "one, two", words) is None


@pytest.mark.parametrize(
    ("at", "sure"), [(ANSWER.index("drone"), 0.25), (ANSWER.index("Free"), 1.0)]
)
async def test_a_planner_is_as_sure_as_of_what_it_says_was_asked(at: int, sure: float) -> None:
    engine = ScriptedEngine([ANSWER], chances=[(at, math.log(0.25))])
    proposal = await Planner(engine.engine()).plan(Prompt("s", "u"), "grammar")
    assert proposal.confidence == sure
